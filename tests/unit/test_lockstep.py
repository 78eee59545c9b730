"""Who is waited for at each tick."""

import numpy as np
import pytest

from services.simulator.clock import Clock
from services.simulator.lockstep import Barrier, in_order

pytestmark = pytest.mark.unit

PLACED = {"camera/0", "camera/1"}
ALL = {*PLACED, "planner", "mapper"}


def started(num_ticks=None, lockstep=True, extra=()):
    clock = Clock(lockstep, ALL, num_ticks)
    for name in (*ALL, *extra):
        clock.appear(name)
    assert clock.start(PLACED)
    return clock


def acknowledge_all(clock, *names):
    for name in names or ALL:
        clock.acknowledge(name, clock.tick)


def test_names_are_sorted_by_number():
    names = ["mapper", "camera/10", "camera/9", "planner", "camera/1"]
    assert in_order(names) == ("camera/1", "camera/9", "camera/10", "mapper", "planner")


def test_the_clock_starts_when_all_are_there_and_all_cameras_are_placed():
    clock = Clock(True, ALL, None)
    assert clock.state == "waiting"
    assert clock.waiting_for(()) == ("camera/0", "camera/1", "mapper", "planner")
    for name in ALL:
        clock.appear(name)
    assert clock.waiting_for({"camera/1"}) == ("camera/0",)
    assert not clock.start({"camera/1"})
    clock.vanish("mapper")
    assert clock.waiting_for(PLACED) == ("mapper",)
    clock.appear("mapper")
    assert clock.start(PLACED)
    assert clock.state == "running"
    assert not clock.start(PLACED)  # only once.


@pytest.mark.parametrize("seed", range(10))
def test_in_whatever_order_they_acknowledge_the_tick_ends_with_the_last(seed):
    rng, clock = np.random.default_rng(seed), started()
    for _ in range(5):
        for name in rng.permutation(sorted(ALL)):
            assert not clock.may_end_tick()
            clock.acknowledge(str(name), clock.tick)
        assert clock.may_end_tick()
        assert clock.end_tick()
        assert not clock.may_end_tick()
    assert clock.tick == 5


def test_the_evaluator_may_lag_by_one_tick_but_not_at_the_ends():
    clock = started(num_ticks=4, extra=["evaluator"])
    acknowledge_all(clock)
    assert clock.missing() == ("evaluator",)  # the first score is waited for.
    clock.acknowledge("evaluator", 0)
    clock.end_tick()
    acknowledge_all(clock)
    assert clock.may_end_tick()  # tick 1 without a score.
    clock.end_tick()
    acknowledge_all(clock)
    assert clock.missing() == ("evaluator",)
    clock.acknowledge("evaluator", 1)
    assert clock.may_end_tick()
    clock.end_tick()
    acknowledge_all(clock)
    clock.acknowledge("evaluator", 2)
    assert clock.missing() == ("evaluator",)  # the last score is waited for.
    clock.acknowledge("evaluator", 3)
    assert clock.may_end_tick()
    assert not clock.end_tick()
    assert clock.state == "finished"
    assert not clock.may_end_tick()


def test_who_is_late_is_named_dropped_and_back_when_it_acknowledges():
    clock = started()
    acknowledge_all(clock, "camera/0", "planner", "mapper")
    assert clock.drop_missing() == ("camera/1",)
    assert clock.dropped == ("camera/1",)
    assert clock.may_end_tick()
    clock.end_tick()
    acknowledge_all(clock, "camera/0", "planner", "mapper")
    assert clock.may_end_tick()  # nobody waits for camera 1 ...
    clock.acknowledge("camera/1", 0)  # ... until it answers, however late.
    assert clock.dropped == ()
    assert clock.missing() == ("camera/1",)


def test_who_leaves_the_bus_is_not_waited_for():
    clock = started()
    acknowledge_all(clock, "camera/0", "planner", "mapper")
    clock.vanish("camera/1")
    assert clock.may_end_tick()
    assert clock.dropped == ()


def test_without_any_camera_time_stands_still_and_says_why():
    clock = started()
    acknowledge_all(clock, "planner", "mapper")
    clock.vanish("camera/0")
    clock.vanish("camera/1")
    assert not clock.may_end_tick()
    assert clock.waiting_for(PLACED) == ("camera/0", "camera/1")
    clock.acknowledge("camera/1", 0)
    assert clock.may_end_tick()


def test_an_acknowledgement_from_before_a_reset_counts_for_nothing():
    clock = started()
    for _ in range(4):
        acknowledge_all(clock)
        clock.end_tick()
    clock.reset()
    assert (clock.state, clock.tick) == ("waiting", 0)
    assert clock.start(PLACED)
    clock.acknowledge("mapper", 4)
    assert "mapper" in clock.missing()
    acknowledge_all(clock)
    assert clock.may_end_tick()


def test_an_old_acknowledgement_does_not_take_back_a_new_one():
    barrier = Barrier()
    barrier.join("mapper")
    barrier.begin(3)
    barrier.acknowledge("mapper", 3)
    barrier.acknowledge("mapper", 2)
    assert barrier.missing() == ()


def test_a_paused_clock_passes_as_many_ticks_as_it_is_stepped():
    clock = started()
    clock.pause()
    acknowledge_all(clock)
    assert clock.state == "paused"
    assert not clock.may_end_tick()
    clock.step(2)
    for tick in (1, 2):
        assert clock.may_end_tick()
        clock.end_tick()
        acknowledge_all(clock)
        assert clock.tick == tick
    assert not clock.may_end_tick()
    clock.resume()
    assert clock.may_end_tick()


def test_in_real_time_nobody_is_waited_for():
    clock = started(num_ticks=2, lockstep=False)
    assert clock.waiting_for(PLACED) == ()
    assert not clock.may_end_tick()  # time alone ends a tick.
    assert clock.end_tick()
    assert not clock.end_tick()
    assert clock.state == "finished"
