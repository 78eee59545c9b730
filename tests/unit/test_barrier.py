"""The barrier: camera order whatever the order of arrival, and never a wait for nobody."""

import itertools

import numpy as np
import pytest

from services.mapper.barrier import Barrier, Close, Take

pytestmark = pytest.mark.unit


def barrier_of(*cameras: int) -> Barrier[str]:
    barrier: Barrier[str] = Barrier()
    for camera in cameras:
        barrier.appear(camera)
    return barrier


def offered(barrier: Barrier[str], tick: int, *cameras: int) -> list:
    return [step for camera in cameras for step in barrier.offer(tick, camera, f"{tick}/{camera}")]


def complete(tick: int, *cameras: int) -> list:
    takes = [Take(tick, camera, f"{tick}/{camera}") for camera in cameras]
    return [*takes, Close(tick, cameras, ())]


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_clouds_are_handed_on_in_camera_order_whatever_the_order_of_arrival(order) -> None:
    barrier = barrier_of(0, 1, 2, 3)
    assert offered(barrier, 5, *order) == complete(5, 0, 1, 2, 3)
    assert barrier.open_tick is None


def test_a_cloud_is_handed_on_as_soon_as_all_before_it_have_come() -> None:
    barrier = barrier_of(0, 1, 2)
    assert offered(barrier, 0, 0) == [Take(0, 0, "0/0")]
    assert offered(barrier, 0, 2) == []
    assert offered(barrier, 0, 1) == [
        Take(0, 1, "0/1"),
        *complete(0, 2)[:1],
        Close(0, (0, 1, 2), ()),
    ]


def test_the_deadline_closes_with_what_has_come_and_names_the_missing() -> None:
    barrier = barrier_of(0, 1, 2)
    assert offered(barrier, 3, 0, 2) == [Take(3, 0, "3/0")]
    assert barrier.expire() == [Take(3, 2, "3/2"), Close(3, (0, 2), (1,))]
    assert barrier.expire() == []


def test_who_missed_a_deadline_is_not_waited_for_until_it_speaks() -> None:
    barrier = barrier_of(0, 1)
    offered(barrier, 0, 0)
    barrier.expire()
    assert offered(barrier, 1, 0) == [Take(1, 0, "1/0"), Close(1, (0,), (1,))]
    assert offered(barrier, 1, 1) == []
    assert barrier.num_late == 1
    assert offered(barrier, 2, 0) == [Take(2, 0, "2/0")]
    assert offered(barrier, 2, 1) == [Take(2, 1, "2/1"), Close(2, (0, 1), ())]


def test_a_camera_that_is_already_further_is_not_waited_for() -> None:
    barrier = barrier_of(0, 1)
    offered(barrier, 0, 0)
    assert offered(barrier, 1, 1) == [Close(0, (0,), (1,))]
    assert offered(barrier, 1, 0) == complete(1, 0, 1)


def test_a_camera_that_goes_is_not_waited_for() -> None:
    barrier = barrier_of(0, 1)
    offered(barrier, 0, 0)
    assert barrier.vanish(1) == [Close(0, (0,), ())]


def test_a_camera_that_nobody_announced_is_used_all_the_same() -> None:
    barrier = barrier_of()
    assert offered(barrier, 0, 7) == complete(0, 7)


def test_the_same_cloud_twice_is_used_once() -> None:
    barrier = barrier_of(0, 1)
    offered(barrier, 0, 0)
    assert offered(barrier, 0, 0) == []
    assert offered(barrier, 0, 1) == [Take(0, 1, "0/1"), Close(0, (0, 1), ())]
    assert barrier.num_late == 0


def test_a_camera_that_goes_back_in_time_begins_a_new_run() -> None:
    barrier = barrier_of(0, 1)
    for tick in range(4):
        offered(barrier, tick, 0, 1)
    assert offered(barrier, 0, 1, 0) == complete(0, 0, 1)
    assert offered(barrier, 1, 0, 1) == complete(1, 0, 1)
    assert barrier.num_late == 0


@pytest.mark.parametrize("seed", range(20))
def test_whatever_arrives_ticks_close_once_in_order_and_clouds_are_used_at_most_once(seed) -> None:
    rng = np.random.default_rng(seed)
    barrier = barrier_of(0, 1, 2)
    streams = [np.flatnonzero(rng.random(30) < 0.8).tolist() for _ in range(3)]
    steps: list = []
    while any(streams):
        camera = int(rng.integers(3))
        if streams[camera]:
            steps += offered(barrier, streams[camera].pop(0), camera)
        if rng.random() < 0.1:
            steps += barrier.expire()
    while barrier.open_tick is not None:
        steps += barrier.expire()
    ticks = [step.tick for step in steps if isinstance(step, Close)]
    assert ticks == sorted(set(ticks))
    taken = [(step.tick, step.camera) for step in steps if isinstance(step, Take)]
    assert len(taken) == len(set(taken))
    assert [tick for tick, _ in taken] == sorted(tick for tick, _ in taken)
    used = [
        (step.tick, camera) for step in steps if isinstance(step, Close) for camera in step.used
    ]
    assert used == taken


def test_a_camera_that_comes_late_is_waited_for_from_its_first_word_on() -> None:
    barrier = barrier_of(0)
    offered(barrier, 3, 0)
    barrier.appear(1)
    assert barrier.alive == (0, 1)
    assert offered(barrier, 4, 0) == complete(4, 0)  # It may have no place in the world yet.
    assert offered(barrier, 5, 1, 0) == complete(5, 0, 1)
    assert offered(barrier, 6, 0) == complete(6, 0)[:1]
    assert barrier.vanish(1) == [Close(6, (0,), ())]
