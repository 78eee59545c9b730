"""The planner that is not told where the target is: from a tracker's words, and from the map."""

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from schemas.geometry import Pose
from schemas.map import FREE, OCCUPIED, MapChanges
from schemas.sim import SimClock
from schemas.target import TargetEstimate
from schemas.topics import (
    CAMERA_GOAL,
    FORMATION,
    MAP_CHANGES,
    SIM_CLOCK,
    TARGET_ESTIMATE,
    TARGET_OBSERVATION,
    TARGET_POSE,
)
from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.settings import BusSettings
from services.simulator.settings import SimulatorSettings
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

TIMEOUT_S = 10.0
DT_NS = 66_666_667
NUM_CAMERAS = 3
VOXEL_M = 0.02
CORNER_M = -3.0
MOTION = SimulatorSettings().motion()


@contextmanager
def planning(endpoint: str, **settings: object) -> Iterator[Loop]:
    bus_settings = BusSettings(connect=endpoint, shm_pool_mib=0)
    chosen = PlannerSettings(bus=bus_settings, cameras=NUM_CAMERAS, dt_s=DT_NS * 1e-9, **settings)
    with Bus(bus_settings, "planner") as bus:
        loop = Loop(bus)
        service = PlannerService(chosen, bus, loop)
        with running(loop):
            yield loop
        del service


class User:
    """Tells the planner of instants, one after the other, and hears what it makes of them."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.formations = bus.every(FORMATION)
        self.estimates = bus.every(TARGET_ESTIMATE)
        self.goals = bus.every(CAMERA_GOAL)

    def tell(self, topic, message) -> None:
        while not self.bus.matching(topic):
            threading.Event().wait(0.01)
        self.bus.publish(topic, message)
        formation = self.formations.get(TIMEOUT_S).message
        assert (formation.tick, formation.frame_id) == (message.tick, "world")
        self.centre = np.array(formation.centre)
        goals = [self.goals.get(TIMEOUT_S).message for _ in range(NUM_CAMERAS)]
        assert {goal.tick for goal in goals} == {message.tick}

    def estimate(self) -> TargetEstimate:
        return self.estimates.get(TIMEOUT_S).message


@pytest.fixture
def user(endpoint) -> Iterator[User]:
    with Bus(BusSettings(connect=endpoint, shm_pool_mib=16), "test") as bus:
        yield User(bus)


def truth(tick):
    return MOTION.at(tick * DT_NS * 1e-9)


def off_m(user: User, tick: int) -> float:
    """Return how far the formation is from where the target will be at the next instant."""
    return math.dist(user.centre[:2], truth(tick + 1).position_m)


def observe(user: User, num_ticks: int, **tracker: object) -> list[float]:
    watcher = SimulatorSettings(**tracker).tracker()
    found = []
    for tick in range(num_ticks):
        user.tell(TARGET_OBSERVATION, watcher.observation(MOTION, tick, tick * DT_NS))
        found.append(off_m(user, tick))
    return found


def test_a_perfect_tracker_is_as_good_as_the_pose(endpoint, user):
    with planning(endpoint, target="filtered"):
        off = observe(user, 60)
    assert max(off[20:]) < 0.002


def test_noise_delay_and_losses_are_filtered_and_made_up_for(endpoint, user):
    bad = {
        "target_noise_m": 0.02,
        "target_noise_rad": 0.006,
        "target_delay_s": 0.1,
        "target_dropout": 0.2,
    }
    off, estimates = [], []
    watcher = SimulatorSettings(**bad, seed=5).tracker()
    with planning(endpoint, target="filtered"):
        for tick in range(200):
            user.tell(TARGET_OBSERVATION, watcher.observation(MOTION, tick, tick * DT_NS))
            off.append(off_m(user, tick))
            estimates.append(user.estimate())
    newest = estimates[-1]
    assert 20 < newest.num_missed < 60
    assert newest.num_used + newest.num_missed > 195  # The first is told again until the delay.
    assert newest.num_refused == 0
    # What is seen is 0.1 s old and predicted 0.067 s ahead of now: 3 cm at 0.19 m/s and more.
    assert np.sqrt(np.mean(np.square(off[30:]))) < 0.02
    assert max(off[30:]) < 0.06
    for estimate in estimates[30:]:
        here = truth(estimate.tick).position_m
        assert math.dist(estimate.pose.position[:2], here) < 5 * estimate.sigma_m


def test_before_the_tracker_has_seen_anything_the_guess_counts(endpoint, user):
    with planning(endpoint, target="filtered", guess_m=(1.0, -2.0)):
        observe(user, 3, target_dropout=1.0)
        np.testing.assert_allclose(user.centre[:2], [1.0, -2.0])


def test_an_instant_told_twice_is_answered_twice_and_the_same(endpoint, user):
    watcher = SimulatorSettings(target_noise_m=0.02).tracker()
    with planning(endpoint, target="filtered"):
        for tick in range(10):
            told = watcher.observation(MOTION, tick, tick * DT_NS)
            user.tell(TARGET_OBSERVATION, told)
            before, centre = user.estimate(), user.centre
            user.tell(TARGET_OBSERVATION, told)
            assert user.estimate() == before
            np.testing.assert_array_equal(user.centre, centre)


def test_when_time_goes_back_the_filter_begins_anew(endpoint, user):
    with planning(endpoint, target="filtered"):
        first = observe(user, 20, target_noise_m=0.02)
        assert observe(user, 20, target_noise_m=0.02) == first


def test_what_was_seen_after_it_was_told_is_refused(endpoint, user):
    sane = SimulatorSettings().tracker().observation(MOTION, 5, 5 * DT_NS)
    early = sane.model_copy(update={"t_ns": 4 * DT_NS})
    with planning(endpoint, target="filtered") as loop:
        user.tell(TARGET_OBSERVATION, sane)
        user.bus.publish(TARGET_OBSERVATION, early)
        while not loop.bus.last_refusal:
            threading.Event().wait(0.01)
        assert "told before" in loop.bus.last_refusal


class Mapper:
    """Publishes the map of a can that drives over the ground, as changes between instants."""

    def __init__(self, user: User) -> None:
        self._user, self._before, self._rev = user, set(), 0

    def show(self, tick: int, x: float, y: float, top_m: float = 0.4) -> MapChanges:
        around, up = np.meshgrid(np.linspace(-np.pi, np.pi, 90), np.arange(0.01, top_m, VOXEL_M))
        can = np.stack([x + 0.15 * np.cos(around), y + 0.15 * np.sin(around), up], axis=-1)
        ground = np.stack(np.meshgrid(np.arange(-1, 1, 0.1), np.arange(-1, 1, 0.1), 0.01), axis=-1)
        points = np.concatenate([can.reshape(-1, 3), ground.reshape(-1, 3)])
        voxels = np.floor((points - CORNER_M) / VOXEL_M).astype(int)
        now = set(map(tuple, voxels.tolist()))
        rows = [(*v, OCCUPIED) for v in now - self._before]
        rows += [(*v, FREE) for v in self._before - now]
        changes = MapChanges.of(
            np.array(rows, "<i2").reshape(-1, 4),
            t_ns=tick * DT_NS,
            tick=tick,
            frame_id="world",
            rev=self._rev + 1,
            base_rev=self._rev,
            resolution_m=VOXEL_M,
            origin=(CORNER_M, CORNER_M, CORNER_M),
            shape_voxels=(300, 300, 300),
            pose=Pose.from_matrix(np.eye(4)),
        )
        self._before, self._rev = now, self._rev + 1
        self._user.tell(MAP_CHANGES, changes)
        return changes


def clock(state: str) -> SimClock:
    return SimClock(
        t_ns=0, tick=0, frame_id="world", dt_ns=DT_NS, mode="lockstep", state=state, t_wall_ns=0
    )


def test_the_target_is_found_in_the_map_and_nobody_listens_to_its_pose(endpoint, user):
    mapper, off = Mapper(user), []
    with planning(endpoint, target="map", guess_m=(0.2, 0.1)):
        user.tell(SIM_CLOCK, clock("waiting"))
        np.testing.assert_allclose(user.centre[:2], [0.2, 0.1])
        for tick in range(120):
            mapper.show(tick, *truth(tick).position_m)
            off.append(off_m(user, tick))
            estimate = user.estimate()
        assert not user.bus.matching(TARGET_POSE)
        assert not user.bus.matching(TARGET_OBSERVATION)
    assert max(off) < 0.12  # Until it is sure that the target moves, the formation lags.
    assert max(off[30:]) < 0.03
    assert np.hypot(*estimate.twist.linear[:2]) == pytest.approx(truth(119).v_m_s, abs=0.05)
    assert (estimate.num_used, estimate.num_missed) == (120, 0)


def test_changes_told_twice_are_answered_twice_and_looked_at_once(endpoint, user):
    mapper = Mapper(user)
    with planning(endpoint, target="map"):
        for tick in range(8):
            changes = mapper.show(tick, *truth(tick).position_m)
            before, centre = user.estimate(), user.centre
            user.tell(MAP_CHANGES, changes)
            assert user.estimate() == before
            np.testing.assert_array_equal(user.centre, centre)


def test_an_empty_map_is_looked_at_from_the_guess(endpoint, user):
    with planning(endpoint, target="map", guess_m=(0.5, 0.5)):
        Mapper(user).show(0, 0.0, 0.0, top_m=0.04)
        np.testing.assert_allclose(user.centre[:2], [0.5, 0.5])


def test_a_map_in_the_targets_frame_would_tell_its_pose_and_is_refused(endpoint, user):
    with planning(endpoint, target="map") as loop:
        mapper = Mapper(user)
        changes = mapper.show(0, 0.0, 0.0)
        user.bus.publish(MAP_CHANGES, changes.model_copy(update={"frame_id": "target"}))
        mapper.show(1, 0.0, 0.0)  # Changes come in order: the wrong ones have been seen.
        assert "target map needs a mapper with frame world" in loop.bus.last_refusal
