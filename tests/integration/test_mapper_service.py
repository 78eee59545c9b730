"""A mapper on a real bus: an instant of clouds in; changes, summary and snapshot out."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from schemas.camera import Intrinsics
from schemas.cloud import DepthCloud, XyzCloud
from schemas.geometry import Pose, Twist
from schemas.map import MapChanges, MapSummary
from schemas.sim import SimClock
from schemas.target import TargetPose
from schemas.topics import (
    CAMERA_CLOUD,
    MAP_CHANGES,
    MAP_FULL,
    MAP_SUMMARY,
    SIM_CLOCK,
    TARGET_POSE,
)
from services.kernels.rigid import look_at
from services.mapper.service import MapperService
from services.mapper.settings import MapperSettings
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.loop import Loop
from services.runtime.map_mirror import MapMirror, Outcome
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]
DT_NS = 66_666_667
INTRINSICS = Intrinsics.from_vertical_fov(64, 48, 0.8)
WAIT_S = 10.0


def camera_pose(camera: int) -> np.ndarray:
    angle = camera * np.pi / 3
    return look_at((1.1 * np.cos(angle), 1.1 * np.sin(angle), 0.6), (0, 0, 0.2))


def target_pose(tick: int) -> np.ndarray:
    T = np.eye(4)
    T[:2, 3] = 0.1 * tick, -0.05 * tick
    return T


def depth_of(tick: int, camera: int) -> np.ndarray:
    rng = np.random.default_rng([tick, camera])
    return rng.integers(900, 1300, (48, 64)).astype(np.uint16)


def cloud(tick: int, camera: int) -> DepthCloud:
    T_world_camera = target_pose(tick) @ camera_pose(camera)
    return DepthCloud.of(
        depth_of(tick, camera),
        t_ns=tick * DT_NS,
        tick=tick,
        frame_id="world",
        camera=camera,
        pose=Pose.from_matrix(T_world_camera),
        max_range_m=5.0,
        t_capture_ns=time.time_ns(),
        intrinsics=INTRINSICS,
        depth_scale_m=0.001,
    )


def expected_map(tick: int, cameras: tuple[int, ...]) -> VoxelMap:
    """What `instant` memory in the target's frame must hold."""
    voxel_map = MapperSettings().empty_map()
    k = INTRINSICS
    for camera in cameras:
        pinhole = (k.fx, k.fy, k.cx, k.cy)
        voxel_map.fuse_depth(depth_of(tick, camera), pinhole, camera_pose(camera), 0.001, 5.0)
    return voxel_map


class World:
    """Plays cameras and simulator, and hears the mapper."""

    def __init__(self, open_bus: OpenBus, stack: ExitStack, cameras: int) -> None:
        self.bus = open_bus("simulator")
        self.cameras = [open_bus("camera", str(i), announce=True) for i in range(cameras)]
        self.changes = stack.enter_context(self.bus.every(MAP_CHANGES))
        self.summary = stack.enter_context(self.bus.every(MAP_SUMMARY))

    def tell_target(self, tick: int) -> None:
        still = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
        pose = Pose.from_matrix(target_pose(tick))
        stamp = {"t_ns": tick * DT_NS, "tick": tick, "frame_id": "world"}
        self.bus.publish(TARGET_POSE, TargetPose(**stamp, pose=pose, twist=still))

    def tell_mode(self, mode: str) -> None:
        clock = SimClock(t_ns=0, tick=0, frame_id="world", dt_ns=DT_NS, mode=mode, state="running")
        self.bus.publish(SIM_CLOCK, clock)

    def send(self, tick: int, *cameras: int) -> None:
        for camera in cameras:
            self.cameras[camera].publish(CAMERA_CLOUD, cloud(tick, camera), camera=camera)

    def answer(self) -> tuple[MapChanges, MapSummary]:
        return self.changes.get(WAIT_S).message, self.summary.get(WAIT_S).message

    def instant(self, tick: int, *cameras: int) -> tuple[MapChanges, MapSummary]:
        self.tell_target(tick)
        self.send(tick, *cameras)
        return self.answer()


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


@pytest.fixture
def start(open_bus: OpenBus) -> Iterator[Callable[..., World]]:
    """Start a mapper and a world of so many cameras, connected both ways."""
    with ExitStack() as stack:

        def begin(cameras: int = 3, **settings: object) -> World:
            world = World(open_bus, stack, cameras)
            bus = open_bus("mapper")
            loop = Loop(bus)
            MapperService(MapperSettings(**settings), bus, loop)
            stack.enter_context(running(loop))
            senders = [(world.bus, TARGET_POSE, None), (world.bus, SIM_CLOCK, None)]
            senders += [(bus, MAP_CHANGES, None), (bus, MAP_SUMMARY, None)]
            senders += [(b, CAMERA_CLOUD, i) for i, b in enumerate(world.cameras)]
            until = time.monotonic() + WAIT_S
            while not all(b.matching(topic, i) for b, topic, i in senders):
                assert time.monotonic() < until, "mapper and world never met"
            while world.bus.request("mapper", "get")["cameras"] != list(range(cameras)):
                assert time.monotonic() < until, "the mapper never saw the cameras"
            return world

        yield begin


def test_an_instant_becomes_the_map_of_its_clouds_in_the_targets_frame(start) -> None:
    world = start()
    mirror = MapMirror()
    for tick in range(4):
        changes, summary = world.instant(tick, 2, 0, 1)
        assert mirror.apply(changes) is Outcome.APPLIED
        expected = expected_map(tick, (0, 1, 2))
        assert len(mirror) == expected.counts().occupied
        assert (expected.classify(mirror.centres()) == 2).all()
        np.testing.assert_allclose(changes.pose.matrix(), target_pose(tick), atol=1e-9)
        assert (summary.tick, summary.rev, changes.rev) == (tick, tick + 1, tick + 1)
        assert summary.cameras_used == (0, 1, 2)
        assert summary.cameras_missing == ()
        counts = expected.counts()
        assert (summary.num_free, summary.num_occupied) == (counts.free, counts.occupied)
        assert summary.num_returns == 3 * 48 * 64
        assert summary.latency_ms >= summary.fuse_ms


def test_clouds_wait_for_the_pose_of_their_tick(start) -> None:
    world = start()
    world.instant(0, 0, 1, 2)
    world.send(1, 0, 1, 2)
    with pytest.raises(TimeoutError):
        world.changes.get(0.2)
    world.tell_target(1)
    changes, _ = world.answer()
    np.testing.assert_allclose(changes.pose.matrix(), target_pose(1), atol=1e-9)


def test_a_pose_told_twice_is_answered_twice_and_a_cloud_told_twice_is_not_late(start) -> None:
    world = start()
    told = world.instant(0, 0, 1, 2)
    world.send(0, 1)
    world.tell_target(0)
    assert world.answer() == told
    assert world.instant(1, 0, 1, 2)[1].late_clouds == 0


def test_plausible_messages_of_absurd_values_are_counted_and_change_nothing(
    start, open_bus: OpenBus
) -> None:
    world = start(deadline_s=1.0)
    world.instant(0, 0, 1, 2)
    open_bus("camera", "100", announce=True)  # An index that no message may have.
    absurd = cloud(1, 1).model_copy(update={"tick": 2**62})
    world.cameras[1].publish(CAMERA_CLOUD, absurd, camera=1)
    elsewhere = cloud(1, 1).model_copy(update={"frame_id": "odom"})
    world.cameras[1].publish(CAMERA_CLOUD, elsewhere, camera=1)
    foreign = TargetPose(
        t_ns=0,
        tick=1,
        frame_id="odom",
        pose=Pose.from_matrix(np.eye(4)),
        twist=Twist(linear=(0, 0, 0), angular=(0, 0, 0)),
    )
    world.bus.publish(TARGET_POSE, foreign)
    changes, summary = world.instant(1, 0, 1, 2)
    assert summary.cameras_used == (0, 1, 2)
    assert summary.cameras_missing == ()
    np.testing.assert_allclose(changes.pose.matrix(), target_pose(1), atol=1e-9)


def test_the_deadline_closes_an_instant_and_names_who_is_missing(start) -> None:
    world = start(deadline_s=0.3)
    _, summary = world.instant(0, 0, 2)
    assert (summary.cameras_used, summary.cameras_missing) == ((0, 2), (1,))
    expected = expected_map(0, (0, 2)).counts()
    assert summary.num_occupied == expected.occupied


def test_a_camera_that_dies_is_not_waited_for(start) -> None:
    world = start(deadline_s=30.0)
    world.instant(0, 0, 1, 2)
    world.cameras[1].close()
    _, summary = world.instant(1, 0, 2)
    assert summary.cameras_used == (0, 2)


def test_a_snapshot_taken_in_the_middle_of_an_instant_is_that_of_the_last_changes(start) -> None:
    world = start(deadline_s=30.0)
    mirror = MapMirror()
    mirror.apply(world.instant(0, 0, 1, 2)[0])
    world.tell_target(1)
    world.send(1, 0)
    until = time.monotonic() + WAIT_S
    while world.bus.request("mapper", "get")["occupied"] == len(mirror):
        assert time.monotonic() < until, "the first cloud was never fused"
    healed = MapMirror()
    healed.reset(world.bus.fetch(MAP_FULL))
    np.testing.assert_array_equal(healed.voxels, mirror.voxels)
    world.send(1, 1, 2)
    changes, _ = world.answer()
    for each in (healed, mirror):
        assert each.apply(changes) is Outcome.APPLIED
    np.testing.assert_array_equal(healed.voxels, mirror.voxels)


def test_points_are_fused_as_rays(start) -> None:
    world = start(cameras=1, frame="world")
    points = np.array([[0.0, 0.0, 1.1], [np.nan, 0, 0]], np.float32)
    message = XyzCloud.of(
        points,
        t_ns=0,
        tick=0,
        frame_id="world",
        camera=0,
        pose=Pose.from_matrix(camera_pose(0)),
        max_range_m=5.0,
        t_capture_ns=time.time_ns(),
    )
    world.cameras[0].publish(CAMERA_CLOUD, message, camera=0)
    changes, summary = world.answer()
    assert (summary.num_occupied, summary.num_returns) == (1, 1)
    assert changes.frame_id == "world"


def test_memory_can_be_changed_and_the_map_reset_and_saved(start, tmp_path) -> None:
    world = start(cameras=1)
    ask = world.bus.request
    assert ask("mapper", "set", {"memory": "persistent"})["memory"] == "persistent"
    world.instant(0, 0)
    world.instant(1, 0)
    for name in ("map.ply", "map.npz"):
        saved = ask("mapper", "save", {"path": str(tmp_path / name)})
        assert (tmp_path / name).exists()
    loaded = VoxelMap.load(tmp_path / "map.npz")
    assert loaded.counts().occupied == saved["occupied"] > 0
    assert ask("mapper", "reset")["occupied"] == 0


@pytest.mark.parametrize(
    ("verb", "params", "says"),
    [
        ("set", {"memory": "elephant"}, "persistent"),
        ("set", {"memroy": "instant"}, "known: memory, half_life_s"),
        ("set", {"half_life_s": -1.0}, "greater than 0"),
        ("save", {"path": "/nowhere/at/all/map.ply"}, "cannot write"),
        ("save", {"path": "map.pcd"}, r"known: \.npz, \.ply"),
        ("save", {}, "path"),
    ],
)
def test_a_wrong_request_gets_a_clear_answer(start, verb, params, says) -> None:
    world = start(cameras=1)
    with pytest.raises(CommandFailed, match=says):
        world.bus.request("mapper", verb, params)


def test_realtime_goes_on_after_the_shorter_deadline(start) -> None:
    world = start(deadline_s=30.0, realtime_deadline_s=0.5)
    world.tell_mode("realtime")
    world.instant(0, 0, 1, 2)
    _, summary = world.instant(1, 0, 1)
    assert summary.cameras_missing == (2,)
