"""A place on the loopback for the router."""

import socket

DEFAULT_PORT = 7447  # Zenoh's.


def router_endpoint(port: int | None = None) -> str:
    """Return where the router shall listen.

    Args:
        port: The one to take; None: Zenoh's own, or any free one when that is taken, so that
            several runs live side by side.
    """
    if port is None:
        port = DEFAULT_PORT if is_free(DEFAULT_PORT) else free_port()
    return f"tcp/127.0.0.1:{port}"


def is_free(port: int) -> bool:
    """Whether nobody listens on a loopback port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True


def free_port() -> int:
    """Return a loopback port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def answers(endpoint: str) -> bool:
    """Whether somebody accepts connections at `tcp/host:port`."""
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    try:
        with socket.create_connection((host, int(port)), timeout=0.2):
            return True
    except OSError:
        return False
