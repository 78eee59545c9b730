"""Plays cameras and simulator to a mapper on a real bus, and hears what it says."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np

from schemas.camera import Intrinsics
from schemas.cloud import DepthCloud
from schemas.geometry import Pose, Twist
from schemas.map import MapChanges, MapSummary
from schemas.sim import SimClock
from schemas.target import TargetPose
from schemas.topics import CAMERA_CLOUD, MAP_CHANGES, MAP_SUMMARY, SIM_CLOCK, TARGET_POSE
from services.kernels.rigid import look_at
from services.mapper.service import MapperService
from services.mapper.settings import MapperSettings
from services.mapper.voxel_map import VoxelMap
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from tests.integration.conftest import running

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


def large_cloud(tick: int, camera: int) -> DepthCloud:
    """Return a cloud that goes by shared memory."""
    small = cloud(tick, camera)
    return DepthCloud.of(
        np.tile(depth_of(tick, camera), (5, 5)),
        t_ns=small.t_ns,
        tick=tick,
        frame_id="world",
        camera=camera,
        pose=small.pose,
        max_range_m=5.0,
        t_capture_ns=small.t_capture_ns,
        intrinsics=Intrinsics.from_vertical_fov(320, 240, 0.8),
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

    mapper: Bus
    """The mapper's own session."""

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


@contextmanager
def worlds(open_bus: OpenBus) -> Iterator[Callable[..., World]]:
    """Give a function to start a mapper and a world of so many cameras, connected both ways."""
    with ExitStack() as stack:

        def begin(cameras: int = 3, **settings: object) -> World:
            world = World(open_bus, stack, cameras)
            bus = world.mapper = open_bus("mapper")
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
