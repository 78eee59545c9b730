"""Sockets of links that no close waits for."""

import contextlib
import logging
import os
import socket
import struct
from pathlib import Path

import zenoh

from services.runtime.drains import Drains

logger = logging.getLogger(__name__)

_OFF = struct.pack("ii", 0, 0)
_OPEN_FILES = Path("/proc/self/fd")
"""Linux's; elsewhere nothing is done."""
_MOST_AT_ONCE = 1024  # Links; zenoh takes 1000 sessions.


def no_lingering(session: zenoh.Session, drains: Drains) -> None:
    """Switch lingering off on the socket of every link that a session has or gets.

    Zenoh has a closing socket linger for 10 s, on a thread that routes messages: when another host
    falls silent, and so will never confirm what was sent, all of a session stands still for as
    long (eclipse-zenoh/zenoh#1101, #2718). Its configuration has no word for it.
    """
    links = session.info.declare_link_events_listener(
        zenoh.handlers.RingChannel(_MOST_AT_ONCE), history=True
    )

    def attend() -> None:
        for event in links:
            link = event.link
            if event.kind == zenoh.SampleKind.PUT and not let_go(link.src, link.dst):
                logger.debug("the socket of %s => %s was not found", link.src, link.dst)

    drains.start("links", attend)


def let_go(ours: str, theirs: str) -> bool:
    """Have the socket between two locators close at once; return whether it was found.

    What was sent and not confirmed is still sent again by the kernel, as after any close.
    """
    ends = _place(ours), _place(theirs)
    try:
        entries = os.listdir(_OPEN_FILES)
    except OSError:
        return False
    for entry in entries:
        with contextlib.suppress(OSError):  # Not a connected socket, or closed meanwhile.
            if not os.readlink(_OPEN_FILES / entry).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry))) as ear:
                if (_shown(ear.getsockname()), _shown(ear.getpeername())) == ends:
                    ear.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)
                    return True
    return False


def _place(locator: str) -> str:
    return locator.partition("/")[2].partition("?")[0].partition("#")[0]


def _shown(address: object) -> str:
    if not isinstance(address, tuple):
        return ""
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
