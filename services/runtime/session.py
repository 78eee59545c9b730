"""Opening zenoh: a peer that finds the others through a router, or that router itself."""

import json
import os
from typing import Any

import zenoh

from services.runtime.errors import BusUnavailable
from services.runtime.settings import BusSettings

LEASE_MS = 3000  # A silent peer is given up after this; zenoh's default is 10 s.


def open_peer(settings: BusSettings) -> zenoh.Session:
    """Open a service's session; a router that is not there yet is tried again for ever.

    Raises:
        BusUnavailable: If an endpoint is malformed or taken.
    """
    config = _common()
    connect = [settings.connect] if settings.connect else []
    listen = [settings.listen] if settings.listen else []
    _insert(config, "mode", "peer")
    _insert(config, "connect/endpoints", connect)
    _insert(
        config,
        "connect/retry",
        {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
    )
    _insert(config, "listen/endpoints", listen)
    if settings.namespace:
        _insert(config, "namespace", settings.namespace)
    return _open(config, f"connect {connect}, listen {listen}")


def open_router(listen: str) -> zenoh.Session:
    """Open a router that introduces the peers to each other.

    Raises:
        BusUnavailable: If the endpoint is malformed or taken.
    """
    config = _common()
    _insert(config, "mode", "router")
    _insert(config, "listen/endpoints", [listen])
    _insert(config, "adminspace/permissions", {"read": True, "write": False})
    return _open(config, f"listen {listen}")


def locators(session: zenoh.Session) -> list[str]:
    """Return the endpoints at which this session can be reached."""
    replies = session.get(f"@/{session.info.zid()}/*", timeout=2.0)
    for reply in replies:
        if reply.ok is not None:
            return [str(locator) for locator in json.loads(reply.ok.payload.to_bytes())["locators"]]
    return []


def _common() -> zenoh.Config:
    config = zenoh.Config()
    _insert(config, "scouting/multicast/enabled", False)  # Nothing is sought beyond `connect`.
    _insert(config, "scouting/gossip/enabled", True)
    _insert(config, "scouting/delay", 50)
    _insert(config, "adminspace/enabled", True)
    _insert(config, "transport/link/tx/lease", LEASE_MS)
    return config


def _insert(config: zenoh.Config, path: str, value: Any) -> None:
    config.insert_json5(path, json.dumps(value))


def _open(config: zenoh.Config, what: str) -> zenoh.Session:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise BusUnavailable(f"{what}: {error} (process {os.getpid()})") from None
