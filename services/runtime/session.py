"""Opening zenoh: a peer that finds the others through a router, or that router itself."""

import json
from typing import Any

import zenoh

from services.runtime.errors import BusUnavailable
from services.runtime.settings import BusSettings

_PRIORITIES = (
    "control", "real_time", "interactive_high", "interactive_low",
    "data_high", "data", "data_low", "background",
)  # fmt: skip
_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,  # Nothing is sought beyond the endpoints we are given.
    "scouting/gossip/enabled": True,
    "scouting/delay": 50,
    "adminspace/enabled": True,
    "transport/link/tx/lease": 3000,  # A silent peer is given up after 3 s; the default is 10.
    # By default two messages may wait per link, and a third is dropped after 1 ms: a burst of three
    # on a busy machine is enough. 16 is zenoh's limit; a frozen receiver costs 20 ms a message.
    "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, 16),
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 20_000,
}


def open_peer(settings: BusSettings) -> zenoh.Session:
    """Open a service's session; a router that is not there yet is tried again for ever.

    Raises:
        BusUnavailable: If an endpoint is malformed or taken.
    """
    options: dict[str, Any] = {
        "mode": "peer",
        "connect/endpoints": [settings.connect] if settings.connect else [],
        "connect/retry": {
            "period_init_ms": 200,
            "period_max_ms": 1000,
            "period_increase_factor": 2,
        },
        "listen/endpoints": [settings.listen] if settings.listen else [],
    }
    if settings.namespace:
        options["namespace"] = settings.namespace
    return _open(options, f"connect {settings.connect!r}, listen {settings.listen!r}")


def open_router(listen: str) -> zenoh.Session:
    """Open a router that introduces the peers to each other.

    Raises:
        BusUnavailable: If the endpoint is malformed or taken.
    """
    options = {
        "mode": "router",
        "listen/endpoints": [listen],
        "adminspace/permissions": {"read": True, "write": False},
    }
    return _open(options, f"listen {listen!r}")


def locators(session: zenoh.Session) -> list[str]:
    """Return the endpoints at which this session can be reached."""
    replies = session.get(f"@/{session.info.zid()}/*", timeout=2.0)
    for reply in replies:
        if reply.ok is not None:
            return [str(locator) for locator in json.loads(reply.ok.payload.to_bytes())["locators"]]
    return []


def _open(options: dict[str, Any], what: str) -> zenoh.Session:
    config = zenoh.Config()
    try:
        for path, value in (_COMMON | options).items():
            config.insert_json5(path, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise BusUnavailable(f"{what}: {str(error).split(' at /')[0]}") from None
