"""The evaluator on a real bus: maps whose quality is known, however their messages arrive."""

import math
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from schemas.camera import CameraInfo, Intrinsics
from schemas.geometry import Pose, Twist
from schemas.map import OCCUPIED, MapChanges, MapFull, MapSummary
from schemas.sim import CameraBody, SceneSpec, SimState
from schemas.topics import (
    CAMERA_INFO,
    MAP_CHANGES,
    MAP_FULL,
    MAP_SUMMARY,
    QUALITY,
    SIM_STATE,
)
from services.evaluator.samples import place, sample
from services.evaluator.service import EvaluatorService
from services.evaluator.settings import EvaluatorSettings
from services.evaluator.surface import Surface
from services.kernels.rigid import look_at, planar
from services.runtime.loop import Loop
from services.world.scene import Scene
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

TIMEOUT_S = 20.0
DT_NS = 50_000_000
VOXEL_M = 0.01
ORIGIN_M = (-0.6, -0.6, -0.1)
NUM_CAMERAS = 6
SPEED_M = 0.05  # Of the target along x, per tick.
SPEC = SceneSpec(object="bunny", height_m=0.4, subdivide=1, deformations=(), seed=0)
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))


def stamp(tick, frame_id="world"):
    return {"t_ns": tick * DT_NS, "tick": tick, "frame_id": frame_id}


def target_pose(tick):
    return planar(SPEED_M * tick, 0.3, 0.2)


def state(tick):
    """The target drives along x, a hexagon of cameras around it."""
    T, away = target_pose(tick), 1.1 * math.cos(math.radians(20))
    centre = T[:3, 3] + [0, 0, 0.2]
    cameras = []
    for camera in range(NUM_CAMERAS):
        angle = camera * math.tau / NUM_CAMERAS
        eye = centre + [away * math.cos(angle), away * math.sin(angle), 0.376]
        pose = Pose.from_matrix(look_at(eye, centre))
        cameras.append(CameraBody(camera=camera, pose=pose, twist=STILL))
    return SimState(
        **stamp(tick),
        dt_ns=DT_NS,
        mode="lockstep",
        target=Pose.from_matrix(T),
        twist=STILL,
        scene=SPEC,
        cameras=tuple(cameras),
    )


def info(camera):
    return CameraInfo(
        **stamp(0),
        camera=camera,
        intrinsics=Intrinsics.from_vertical_fov(640, 480, math.radians(45)),
        depth_scale_m=0.001,
        min_range_m=0.1,
        max_range_m=5.0,
        noise="ideal",
    )


@pytest.fixture(scope="module")
def bunny():
    """(N, 3) voxels that the surface passes, indices in the map's box."""
    scene = Scene.from_spec(SPEC)
    surface = Surface(scene.rest.vertices_m, scene.faces)
    points = place(sample(surface, 20_000, seed=1), surface).points_m
    return np.unique(np.floor((points - ORIGIN_M) / VOXEL_M).astype(np.int64), axis=0)


class Mapper:
    """Says on the bus what a mapper would say of given voxels."""

    def __init__(self, bus):
        self._bus = bus

    def header(self, tick, rev):
        return {
            **stamp(tick, "target"),
            "rev": rev,
            "resolution_m": VOXEL_M,
            "origin": ORIGIN_M,
            "shape_voxels": (120, 120, 80),
            "pose": Pose.from_matrix(target_pose(tick)),
        }

    def changes(self, tick, voxels, kind=OCCUPIED, rev=None, base_rev=None):
        rev = tick + 1 if rev is None else rev
        rows = np.column_stack([voxels, np.full(len(voxels), kind)]).astype(np.int16)
        base_rev = rev - 1 if base_rev is None else base_rev
        self._bus.publish(
            MAP_CHANGES, MapChanges.of(rows, base_rev=base_rev, **self.header(tick, rev))
        )

    def summary(self, tick, rev=None, cameras=range(NUM_CAMERAS)):
        message = MapSummary(
            **stamp(tick, "target"),
            rev=tick + 1 if rev is None else rev,
            cameras_used=tuple(cameras),
            cameras_missing=(),
            num_returns=0,
            num_occupied=0,
            num_free=0,
            num_changed=0,
            fuse_ms=0,
            latency_ms=0,
            memory="instant",
        )
        self._bus.publish(MAP_SUMMARY, message)

    def full(self, tick, voxels, rev):
        bricks, inverse = np.unique(voxels // 8, axis=0, return_inverse=True)
        log_odds = np.full((len(bricks), 8, 8, 8), -32768, np.int16)
        log_odds[(inverse.ravel(), *(voxels % 8).T)] = 100
        array = np.column_stack([bricks, log_odds.reshape(len(bricks), -1)]).astype(np.int16)
        return MapFull.of(array, **self.header(tick, rev))


class World:
    """The rest of the system, in this test's hands."""

    def __init__(self, bus, qualities):
        self.bus = bus
        self.mapper = Mapper(bus)
        self._qualities = qualities

    def say_state(self, tick):
        self.bus.publish(SIM_STATE, state(tick))

    def say_infos(self, cameras=range(NUM_CAMERAS)):
        for camera in cameras:
            self.bus.publish(CAMERA_INFO, info(camera), camera=camera)

    def quality(self):
        return self._qualities.get(TIMEOUT_S).message


def wait_until(true):
    """Discovery has no event to wait on: ask until it is so, at most `TIMEOUT_S`."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not true():
        assert time.monotonic() < deadline_s
        threading.Event().wait(0.01)


@contextmanager
def evaluator(bus):
    loop = Loop(bus)
    settings = EvaluatorSettings(samples=3000)
    service = EvaluatorService(settings, bus, loop)
    with running(loop):
        yield service


@pytest.fixture
def world(open_bus):
    user = open_bus("test")
    with user.every(QUALITY) as qualities, evaluator(open_bus("evaluator")):
        for topic in (SIM_STATE, MAP_CHANGES, MAP_SUMMARY):
            wait_until(lambda topic=topic: user.matching(topic))
        for camera in range(NUM_CAMERAS):
            wait_until(lambda camera=camera: user.matching(CAMERA_INFO, camera))
        yield World(user, qualities)


def test_a_map_of_the_true_surface_gets_full_marks(world, bunny):
    world.say_infos()
    world.say_state(0)
    world.mapper.changes(0, bunny)
    world.mapper.summary(0)
    quality = world.quality()
    fine, wide = quality.stamp_true
    assert (quality.tick, quality.rev, quality.lag_ticks, quality.skipped_instants) == (0, 1, 0, 0)
    assert (fine.tolerance_m, wide.tolerance_m) == (VOXEL_M, 2 * VOXEL_M)
    assert wide.precision == 1
    assert wide.coverage_observable > 0.99
    assert wide.coverage_visible > 0.99
    assert quality.latency_true == quality.stamp_true
    assert quality.num_samples == 3000
    lost = sum(quality.missing.model_dump().values())
    assert lost == pytest.approx(1 - wide.coverage, abs=1e-6)


def test_half_a_map_is_missing_half_and_says_that_it_is_not_updated(world, bunny):
    world.say_infos()
    world.say_state(0)
    world.mapper.changes(0, bunny[bunny[:, 0] < 60])
    world.mapper.summary(0)
    quality = world.quality()
    assert 0.3 < quality.stamp_true[1].coverage < 0.7
    assert quality.stamp_true[1].precision == 1
    assert quality.missing.not_yet_updated > 0.5 * (1 - quality.stamp_true[1].coverage)


def test_instants_follow_each_other_and_freed_voxels_are_gone(world, bunny):
    world.say_infos()
    for tick in range(4):
        world.say_state(tick)
        if tick == 0:
            world.mapper.changes(tick, bunny)
        else:
            world.mapper.changes(tick, bunny[tick - 1 :: 8], kind=1)
        world.mapper.summary(tick)
        quality = world.quality()
        assert (quality.tick, quality.skipped_instants) == (tick, 0)
        assert quality.lag_ticks == 0
        freed = np.concatenate([bunny[:0], *(bunny[t::8] for t in range(tick))])
        layers_above_ground = bunny[:, 2] >= 11
        gone = np.count_nonzero(freed[:, 2] >= 11)
        assert quality.num_voxels == np.count_nonzero(layers_above_ground) - gone


def test_the_order_of_arrival_does_not_matter(world, bunny):
    world.mapper.summary(0)
    world.mapper.changes(0, bunny)
    world.say_state(0)
    world.say_infos()
    quality = world.quality()
    assert quality.tick == 0
    assert quality.stamp_true[1].coverage_observable > 0.99


def test_a_map_is_late_by_how_far_the_target_went(world, bunny):
    world.say_infos()
    for rev, tick in enumerate((0, 3), start=1):
        world.say_state(tick)
        world.mapper.changes(tick, bunny, rev=rev)
        world.mapper.summary(tick, rev=rev)
        assert world.quality().lag_ticks == 0
    # A third map, of the first instant, comes when the truth is already at the fourth.
    world.mapper.changes(0, bunny, rev=3)
    world.mapper.summary(0, rev=3)
    quality = world.quality()
    # The target has moved by 15 cm: what was true then is ghosts and gaps now.
    assert quality.stamp_true[1].precision == 1
    assert quality.lag_ticks == 3
    assert quality.latency_true[1].precision < 0.5
    assert quality.latency_true[1].coverage < quality.stamp_true[1].coverage


def test_missed_changes_are_healed_by_a_snapshot(world, bunny):
    mapper_loop = Loop(world.bus)
    mapper_loop.answer(MAP_FULL, lambda: world.mapper.full(5, bunny, rev=6))
    with running(mapper_loop):
        world.say_infos()
        world.say_state(5)
        world.mapper.changes(5, bunny[:10], rev=6)
        world.mapper.summary(5, rev=6)
        quality = world.quality()
    assert (quality.tick, quality.rev) == (5, 6)
    assert quality.stamp_true[1].coverage_observable > 0.99


def test_a_mapper_that_starts_anew_is_followed_from_its_empty_map(world, bunny, open_bus):
    world.say_infos()
    world.say_state(0)
    world.mapper.changes(0, bunny)
    world.mapper.summary(0)
    assert world.quality().stamp_true[1].coverage_observable > 0.99
    second = open_bus("mapper")
    wait_until(lambda: second.matching(MAP_CHANGES) and second.matching(MAP_SUMMARY))
    world.say_state(1)
    Mapper(second).changes(1, bunny[:0], rev=1, base_rev=0)
    Mapper(second).summary(1, rev=1)
    quality = world.quality()
    assert (quality.tick, quality.rev, quality.num_voxels) == (1, 1, 0)
    assert quality.stamp_true[1].coverage == 0
