"""No close of a link waits for the other end: a host that fell silent would hold all up."""

import os
import socket
import struct
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from services.runtime.bus import Bus
from services.runtime.linger import let_go
from services.runtime.router import router
from services.runtime.settings import BusSettings

pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux's /proc"),
]

ON = struct.pack("ii", 1, 10)


def lingers(ear: socket.socket) -> bool:
    return struct.unpack("ii", ear.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))[0] != 0


def locator(address: tuple[str, int]) -> str:
    return f"tcp/{address[0]}:{address[1]}"


def connected() -> list[socket.socket]:
    """Return this process's connected TCP sockets, as copies."""
    found = []
    for entry in os.listdir("/proc/self/fd"):
        with suppress(OSError), ExitStack() as stack:
            if not os.readlink(f"/proc/self/fd/{entry}").startswith("socket:"):
                continue
            ear = stack.enter_context(socket.socket(fileno=os.dup(int(entry))))
            if ear.family == socket.AF_INET and ear.type == socket.SOCK_STREAM:
                ear.getpeername()
                found.append(ear)
                stack.pop_all()  # It stays open.
    return found


def test_only_the_socket_that_is_meant_is_changed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as stack:
        ours = [
            stack.enter_context(socket.create_connection(server.getsockname())) for _ in range(2)
        ]
        theirs = [stack.enter_context(server.accept()[0]) for _ in range(2)]
        for each in (*ours, *theirs):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, ON)
        assert let_go(locator(ours[0].getsockname()), locator(ours[0].getpeername()))
        assert [lingers(each) for each in (*ours, *theirs)] == [False, True, True, True]
        assert not let_go("tcp/127.0.0.1:1", "tcp/127.0.0.1:2")


def test_no_link_of_a_session_or_a_router_lingers() -> None:
    with router() as endpoint, ExitStack() as stack:
        for service in ("mapper", "planner", "simulator"):
            stack.enter_context(Bus(BusSettings(connect=endpoint), service))
        until_s = time.monotonic() + 10.0
        while True:
            ears = connected()
            states = [lingers(ear) for ear in ears]
            for ear in ears:
                ear.close()
            # Three links to the router and three among them, both ends in this process.
            if len(states) >= 12 and not any(states):
                return
            assert time.monotonic() < until_s, states
            time.sleep(0.02)
