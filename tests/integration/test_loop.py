"""The one thread on which a service happens."""

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest

from schemas.topics import MAP_FULL, TARGET_POSE
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.loop import Loop
from services.runtime.reader import Received
from services.runtime.router import router
from tests.examples import EXAMPLES
from tests.integration.conftest import running
from tests.integration.test_bus import wait_until_read

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]


def test_timers_come_in_the_order_they_are_due_and_a_cancelled_one_never(
    open_bus: OpenBus,
) -> None:
    loop, calls = Loop(open_bus("mapper")), queue.Queue()
    loop.after(0.05, lambda: calls.put("late"))
    loop.after(0.01, lambda: calls.put("early"))
    loop.after(0.03, lambda: calls.put("never")).cancel()
    with running(loop):
        assert [calls.get(timeout=5), calls.get(timeout=5)] == ["early", "late"]
    assert calls.empty()


def test_a_periodic_call_that_was_late_does_not_come_in_a_burst(open_bus: OpenBus) -> None:
    loop, times = Loop(open_bus("mapper")), queue.Queue()

    def slow_first_time() -> None:
        times.put(time.monotonic())
        if times.qsize() == 1:
            time.sleep(0.3)  # The handler itself is what is slow here, not the test.

    loop.every(0.05, slow_first_time)
    with running(loop):
        first, second, third = (times.get(timeout=5) for _ in range(3))
    assert second - first >= 0.3
    assert third - second >= 0.04


def test_all_handlers_run_on_one_thread(open_bus: OpenBus) -> None:
    asker, loop = open_bus("launcher"), Loop(open_bus("mapper"))
    threads: queue.Queue[int] = queue.Queue()
    loop.serve("a", lambda _: threads.put(threading.get_ident()) or {})
    loop.serve("b", lambda _: threads.put(threading.get_ident()) or {})
    loop.after(0.0, lambda: threads.put(threading.get_ident()))
    with running(loop):
        asker.request("mapper", "a")
        asker.request("mapper", "b")
    assert len({threads.get(timeout=5) for _ in range(3)}) == 1


def test_a_request_at_a_gate_is_answered_when_the_gate_lets_it_through(open_bus: OpenBus) -> None:
    asker, loop = open_bus("launcher"), Loop(open_bus("mapper"))
    waiting: queue.Queue[Callable[[], None]] = queue.Queue()
    answers: queue.Queue[dict[str, object]] = queue.Queue()
    loop.serve("a", lambda params: params, gate=waiting.put)
    asks = threading.Thread(
        target=lambda: answers.put(asker.request("mapper", "a", {"n": 1}, timeout_s=10))
    )
    with running(loop):
        asks.start()
        let_through = waiting.get(timeout=5)
        with pytest.raises(queue.Empty):
            answers.get(timeout=0.1)
        let_through()
        assert answers.get(timeout=5) == {"n": 1}
        asks.join(5)


def test_a_refused_request_is_counted_with_its_reason(open_bus: OpenBus) -> None:
    asker, bus = open_bus("launcher"), open_bus("mapper")
    loop = Loop(bus)

    def refuse(_: dict[str, object]) -> dict[str, object]:
        raise ValueError("radius 99 m must be at most 10 m")

    loop.serve("a", refuse)
    with running(loop):
        for count in (1, 2):
            with pytest.raises(CommandFailed, match="radius 99 m must be at most 10 m"):
                asker.request("mapper", "a")
            assert [meter.bad for meter in bus.meters if meter.key == "ctl/mapper/a"] == [count]
    assert "radius 99 m" in bus.last_refusal


def test_a_topic_on_request_is_fetched_whole(open_bus: OpenBus) -> None:
    asker, loop = open_bus("viewer"), Loop(open_bus("mapper"))
    full = EXAMPLES["map_full"][1]
    loop.answer(MAP_FULL, lambda: full)
    with running(loop):
        assert asker.fetch(MAP_FULL) == full


def test_what_the_core_refuses_is_counted_and_the_service_lives(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("simulator"), open_bus("planner")
    loop, seen = Loop(receiver), queue.Queue()

    def picky(received: Received) -> None:
        if received.message.tick == 1:
            raise ValueError("tick 1 is out of reach")
        seen.put(received.message.tick)

    loop.on(TARGET_POSE, picky, every=True)
    pose = EXAMPLES["target_pose"][1]
    with running(loop):
        wait_until_read(sender, TARGET_POSE)
        for tick in (0, 1, 2):
            sender.publish(TARGET_POSE, pose.model_copy(update={"tick": tick}))
        assert [seen.get(timeout=5), seen.get(timeout=5)] == [0, 2]
    (meter,) = [meter for meter in receiver.meters if meter.key == "target/pose"]
    assert meter.bad == 1
    assert "tick 1 is out of reach" in receiver.last_refusal


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_service_ends_within_two_seconds_of_a_signal(number: int) -> None:
    with router() as endpoint:
        process = subprocess.Popen(
            [sys.executable, "-m", "services.planner", "--bus.connect", endpoint],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr is not None
        for line in process.stderr:
            if " up: " in line:
                break
        start_s = time.monotonic()
        os.kill(process.pid, number)
        _, rest = process.communicate(timeout=10)
    assert time.monotonic() - start_s < 2.0
    assert process.returncode == 0, rest


def test_a_wrong_setting_ends_with_its_rule() -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "services.planner", "--bus.shm-pool-mib", "-3"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 2
    assert "shm_pool_mib" in ended.stderr.replace("-", "_")
