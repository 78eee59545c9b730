"""Whether a router takes a new session: old ones may go on long after it has ceased to.

Source: eclipse-zenoh/zenoh#2735 (a router that silently takes no more sessions).
"""

import json
import socket
import time
from typing import NamedTuple

from services.runtime.errors import BusUnavailable
from services.runtime.session import open_client
from services.runtime.settings import BusSettings

TIMEOUT_S = 3.0


class RouterAnswer(NamedTuple):
    """What a router says of itself."""

    seconds: float
    """What opening a session took."""
    version: str
    """Zenoh's; empty when it does not tell."""
    sessions: int
    """How many it has, ours included; 0 when it does not tell."""


def listens(endpoint: str, timeout_s: float = 1.0) -> bool:
    """Whether somebody accepts connections at `tcp/host:port` or `tls/host:port`.

    Other transports have no connection to try: for them the answer is always yes.
    """
    scheme, _, place = endpoint.partition("/")
    host, _, port = place.partition("#")[0].rpartition(":")
    if scheme not in ("tcp", "tls") or not port.isdigit():
        return True
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout_s):
            return True
    except OSError:
        return False


def ask_router(settings: BusSettings, address: str, timeout_s: float = TIMEOUT_S) -> RouterAnswer:
    """Open a session with the router alone, ask what it is, and leave again.

    Raises:
        BusUnavailable: If no session comes about in time.
    """
    start_s = time.monotonic()
    with open_client(settings, address, timeout_s) as session:
        seconds = time.monotonic() - start_s
        for reply in session.get("@/*/router", timeout=timeout_s):
            if reply.ok is None:
                continue
            try:
                told = json.loads(reply.ok.payload.to_bytes())
                return RouterAnswer(seconds, str(told["version"]), len(told["sessions"]))
            except (ValueError, KeyError, TypeError) as error:
                raise BusUnavailable(
                    f"{settings.connect}: not a router's answer: {error}"
                ) from None
    return RouterAnswer(seconds, "", 0)
