"""Who is reached from its own machine alone meets all that it reaches itself."""

import socket
from contextlib import ExitStack

import pytest

from schemas.topics import TARGET_POSE
from services.runtime.bus import Bus
from services.runtime.router import router
from services.runtime.settings import BusSettings
from tests.examples import EXAMPLES

pytestmark = pytest.mark.integration

HERE, EVERYWHERE, NOWHERE = "tcp/127.0.0.1:0", "tcp/0.0.0.0:0", ""
TARGET = EXAMPLES["target_pose"][1]


def has_network() -> bool:
    """Whether `EVERYWHERE` is more than the loopback: zenoh tells of no loopback there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # Nothing is sent; it only asks for a route.
        except OSError:
            return False
    return True


@pytest.mark.parametrize(
    ("first", "second"),
    [(HERE, HERE), (HERE, NOWHERE), (HERE, EVERYWHERE), (NOWHERE, EVERYWHERE), (EVERYWHERE,) * 2],
)
@pytest.mark.parametrize("attempt", range(3))  # Identifiers are drawn; either may be the greater.
def test_peers_hear_each_other(first: str, second: str, attempt: int) -> None:
    if EVERYWHERE in (first, second) and not has_network():
        pytest.skip("this machine has no network but the loopback")
    with router() as endpoint, ExitStack() as stack:
        sender, receiver = (
            stack.enter_context(Bus(BusSettings(connect=endpoint, listen=listen), service))
            for listen, service in ((first, "simulator"), (second, f"planner{attempt}"))
        )
        with receiver.subscribe(TARGET_POSE) as poses:
            for _ in range(100):
                sender.publish(TARGET_POSE, TARGET)
                try:
                    assert poses.get(0.1).message == TARGET
                    return
                except TimeoutError:
                    continue
    pytest.fail("nothing came through in 10 s")
