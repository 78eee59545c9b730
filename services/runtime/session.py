"""Opening zenoh: a peer that finds the others through a router, or that router itself."""

import contextlib
import json
import threading
import time
from collections.abc import Collection, Iterator
from typing import Any

import zenoh

from services.runtime.errors import BusUnavailable
from services.runtime.guard import guarding
from services.runtime.settings import BusSettings

_PRIORITIES = (
    "control", "real_time", "interactive_high", "interactive_low",
    "data_high", "data", "data_low", "background",
)  # fmt: skip
_MEETING_S, _TELLING_S, _LOOK_S = 3.0, 0.5, 0.05
_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,  # Nothing is sought beyond the endpoints we are given.
    "scouting/gossip/enabled": True,
    "scouting/delay": 50,
    "adminspace/enabled": True,
    # A connection that got no answer is begun anew; the kernel would ask again after 1, 2, 4, 8 s.
    "transport/unicast/open_timeout": 3000,
    # Each session would copy what is larger than 3 kB into a second pool of its own, of 16 MiB.
    "transport/shared_memory/transport_optimization/enabled": False,
    "transport/link/tx/lease": 3000,  # A silent peer is given up after 3 s; the default is 10.
    # By default two messages may wait per link, and a third is dropped after 1 ms: a burst of three
    # on a busy machine is enough. 16 is zenoh's limit; a frozen receiver costs 20 ms a message.
    "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, 16),
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 20_000,
}


def open_peer(settings: BusSettings, address: str) -> zenoh.Session:
    """Open a service's session; a router that is not there yet is tried again for ever.

    Args:
        settings: how it joins.
        address: `service` or `service/instance`, whose certificate it shows.

    Raises:
        BusUnavailable: If an endpoint is malformed or taken, or a certificate is missing.
    """
    guard = guarding(settings, address)
    options: dict[str, Any] = guard.options | {
        "mode": "peer",
        "connect/endpoints": [guard.link(settings.connect)] if settings.connect else [],
        "connect/retry": {
            "period_init_ms": 200,
            "period_max_ms": 1000,
            "period_increase_factor": 2,
        },
        "listen/endpoints": [guard.link(settings.listen)] if settings.listen else [],
        "scouting/gossip/autoconnect_strategy": {
            "peer": {"to_router": "always", "to_peer": _who_connects(settings.listen)}
        },
    }
    if settings.namespace:
        options["namespace"] = settings.namespace
    return _open(options, f"connect {settings.connect!r}, listen {settings.listen!r}")


def open_client(settings: BusSettings, address: str, timeout_s: float) -> zenoh.Session:
    """Open a session with the router alone.

    Raises:
        BusUnavailable: If it does not come about in time, or a certificate is missing.
    """
    guard = guarding(settings, address)
    options: dict[str, Any] = guard.options | {
        "mode": "client",
        "connect/endpoints": [guard.link(settings.connect)],
        "connect/timeout_ms": round(timeout_s * 1e3),
        "connect/exit_on_failure": True,
        "listen/endpoints": [],
    }
    return _open(options, f"connect {settings.connect!r} within {timeout_s:g} s")


def open_router(listen: str, settings: BusSettings) -> zenoh.Session:
    """Open a router that introduces the peers to each other.

    Args:
        listen: its endpoint.
        settings: whom it lets in.

    Raises:
        BusUnavailable: If the endpoint is malformed or taken, or a certificate is missing.
    """
    guard = guarding(settings, "router")
    options: dict[str, Any] = guard.options | {
        "mode": "router",
        "listen/endpoints": [guard.link(listen)],
        "adminspace/permissions": {"read": True, "write": False},
    }
    return _open(options, f"listen {listen!r}")


@contextlib.contextmanager
def outside(session: zenoh.Session, settings: BusSettings, address: str) -> Iterator[zenoh.Session]:
    """Give a session that hears what the router tells of itself, which no namespace has.

    Raises:
        BusUnavailable: If one has to be opened and cannot.
    """
    if not settings.namespace:
        yield session
        return
    plain = settings.model_copy(update={"namespace": ""})
    with open_client(plain, address, _MEETING_S) as guest:
        yield guest


def introduce(
    settings: BusSettings, address: str, absent: Collection[str], closing: threading.Event
) -> None:
    """Come once more, as a guest who meets everybody, and go when it has met the absent.

    Every peer tells its new neighbours of all that it has met: so those who have the guest in
    common hear of each other, as they did when they came.

    Args:
        settings: how the session joins. address: whose certificate it shows.
        absent: zenoh identifiers of those to be met. closing: set when it has to go at once.
    """
    alone = settings.model_copy(update={"listen": "", "namespace": ""})
    with contextlib.suppress(BusUnavailable), open_peer(alone, address) as guest:
        until_s = time.monotonic() + _MEETING_S
        while time.monotonic() < until_s and not closing.wait(_LOOK_S):
            if set(absent) <= {str(zid) for zid in guest.info.peers_zid()}:
                closing.wait(_TELLING_S)
                return


def locators(session: zenoh.Session) -> list[str]:
    """Return the endpoints at which this session can be reached."""
    replies = session.get(f"@/{session.info.zid()}/*", timeout=2.0)
    for reply in replies:
        if reply.ok is not None:
            return [str(locator) for locator in json.loads(reply.ok.payload.to_bytes())["locators"]]
    return []


def _who_connects(listen: str) -> str:
    """Return whether we connect to every peer, or to those of a lesser identifier alone.

    If two connect to each other at once, as when a cable is plugged in again, each may hold on to
    its own link and be deaf to the other for good. So on a network one of two connects. Who can be
    reached from this machine alone connects to all: over the loopback no cable is pulled.
    """
    host = listen.partition("/")[2].rpartition(":")[0].strip("[]")
    alone = not host or host == "localhost" or host == "::1" or host.startswith("127.")
    return "always" if alone else "greater-zid"


def _open(options: dict[str, Any], what: str) -> zenoh.Session:
    config = zenoh.Config()
    try:
        for path, value in (_COMMON | options).items():
            config.insert_json5(path, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise BusUnavailable(f"{what}: {str(error).split(' at /')[0]}") from None
