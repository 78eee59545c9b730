"""Who was lost and is still there is found again; who has gone is not looked for for ever."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import SimpleNamespace

import pytest
import zenoh

from services.runtime import reunion
from services.runtime.reunion import Reunion
from services.runtime.router import router
from services.runtime.session import open_peer
from services.runtime.settings import BusSettings

pytestmark = pytest.mark.integration

Open = Callable[[], zenoh.Session]


@pytest.fixture
def open_one() -> Iterator[Open]:
    with router() as endpoint, ExitStack() as stack:
        yield lambda: stack.enter_context(open_peer(BusSettings(connect=endpoint), "planner"))


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reunion, "LOOKS_S", (1.0, 1.2, 1.4))  # A busy router may be as late.


def until(happens: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 10.0
    while not happens():
        assert time.monotonic() < until_s
        threading.Event().wait(0.01)


def gone(zid: zenoh.ZenohId) -> SimpleNamespace:
    """Say of a peer what zenoh says when its transport has been closed."""
    transport = SimpleNamespace(zid=zid, whatami=zenoh.WhatAmI.PEER)
    return SimpleNamespace(kind=zenoh.SampleKind.DELETE, transport=transport)


@pytest.mark.usefixtures("soon")
def test_one_that_is_there_is_asked_for(open_one: Open) -> None:
    ours, other, visits = open_one(), open_one(), []
    until(lambda: other.info.zid() in ours.info.peers_zid())
    # As after a cut: the router has both, and we have no link to the other.
    blind = SimpleNamespace(
        info=SimpleNamespace(
            peers_zid=list,
            routers_zid=ours.info.routers_zid,
            declare_transport_events_listener=lambda _: None,
        ),
        get=ours.get,
    )
    looking = Reunion(blind, lambda: visits.append(time.monotonic()))
    try:
        looking._note(gone(other.info.zid()))
        until(lambda: len(visits) == 3)
    finally:
        looking.close()
    assert looking._lost == {}


@pytest.mark.usefixtures("soon")
def test_one_that_has_gone_or_is_back_is_not(open_one: Open) -> None:
    ours, other, left, visits = open_one(), open_one(), open_one(), []
    until(lambda: {other.info.zid(), left.info.zid()} <= set(ours.info.peers_zid()))
    looking = Reunion(ours, lambda: visits.append(0))
    try:
        left.close()  # Zenoh itself tells of it.
        until(lambda: bool(looking._lost))
        looking._note(gone(other.info.zid()))
        until(lambda: not looking._lost)
    finally:
        looking.close()
    assert visits == []
