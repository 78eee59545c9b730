"""Who is there and not linked is found again; who has gone is not looked for."""

import os
import socket
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
import zenoh

from schemas.topics import CAMERA_POSE
from services.runtime import reunion
from services.runtime.bus import Bus
from services.runtime.reunion import Reunion
from services.runtime.router import router
from services.runtime.session import open_peer
from services.runtime.settings import BusSettings
from tests.examples import EXAMPLES

pytestmark = pytest.mark.integration

Open = Callable[[], zenoh.Session]
POSE = EXAMPLES["camera_pose"][1].model_copy(update={"camera": 1})


@pytest.fixture
def open_one() -> Iterator[Open]:
    with router() as endpoint, ExitStack() as stack:
        yield lambda: stack.enter_context(open_peer(BusSettings(connect=endpoint), "planner"))


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reunion, "WAITS_S", (0.3, 0.3))


def until(happens: Callable[[], bool], timeout_s: float = 20.0) -> None:
    until_s = time.monotonic() + timeout_s
    while not happens():
        assert time.monotonic() < until_s
        threading.Event().wait(0.01)


def break_link(ours: zenoh.Session, theirs: zenoh.ZenohId) -> None:
    """Shut the socket that two sessions of this process share, as a network does that fails."""
    ends = {
        link.src.partition("/")[2] for link in ours.info.links() if str(link.zid) == str(theirs)
    }
    assert ends
    for entry in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            if not os.readlink(Path("/proc/self/fd") / entry).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry))) as ear:
                host, port = ear.getsockname()[:2]
                if f"{host}:{port}" in ends and ear.getpeername():
                    ear.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize("namespace", ["", "second/ring"])
def test_a_link_that_breaks_between_two_is_made_again(
    open_bus: Callable[..., Bus], namespace: str
) -> None:
    camera = open_bus("camera", "1", namespace=namespace)
    mapper = open_bus("mapper", namespace=namespace)
    ours, theirs = camera._session, mapper._session
    with mapper.every(CAMERA_POSE) as poses:
        until(lambda: camera.matching(CAMERA_POSE, 1))
        break_link(ours, theirs.info.zid())
        until(lambda: theirs.info.zid() not in ours.info.peers_zid())
        until(lambda: camera.matching(CAMERA_POSE, 1), timeout_s=40.0)
        camera.publish(CAMERA_POSE, POSE, camera=1)
        assert poses.get(10.0).message == POSE


def blind(session: zenoh.Session) -> SimpleNamespace:
    """Return a session that has lost all peers, though the router has them."""
    info = SimpleNamespace(
        zid=session.info.zid,
        peers_zid=list,
        routers_zid=session.info.routers_zid,
        declare_transport_events_listener=session.info.declare_transport_events_listener,
    )
    return SimpleNamespace(info=info, get=session.get)


@pytest.mark.usefixtures("soon")
def test_one_that_is_there_is_met_again_until_the_link_is_back(
    open_one: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, other = open_one(), open_one()
    until(lambda: other.info.zid() in ours.info.peers_zid())
    without, told = blind(ours), []

    def introduce(_: BusSettings, __: str, absent: Collection[str], ___: threading.Event) -> None:
        told.append(list(absent))
        if len(told) == 3:
            without.info.peers_zid = ours.info.peers_zid

    monkeypatch.setattr(reunion, "introduce", introduce)
    looking = Reunion(without, BusSettings(), "planner")
    try:
        until(lambda: len(told) == 3 and not looking._absent)
        threading.Event().wait(1.0)
    finally:
        looking.close()
    assert told == [[str(other.info.zid())]] * 3


@pytest.mark.usefixtures("soon")
def test_one_that_has_gone_is_not_looked_for(
    open_one: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, other, left, told = open_one(), open_one(), open_one(), []
    until(lambda: {other.info.zid(), left.info.zid()} <= set(ours.info.peers_zid()))
    monkeypatch.setattr(reunion, "introduce", lambda *args: told.append(args))
    looking = Reunion(ours, BusSettings(), "planner")
    try:
        left.close()
        until(lambda: left.info.zid() not in ours.info.peers_zid())
        threading.Event().wait(1.5)
        assert looking._look_s is None, "it looks for somebody"
    finally:
        looking.close()
    assert told == []
