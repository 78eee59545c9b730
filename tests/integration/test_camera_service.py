"""A camera on a real bus: the protocol of an instant, seen from outside."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import cv2
import numpy as np
import pytest

from schemas.camera import CameraGoal, CloudHeard
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody, SceneSpec, SimMode, SimState
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_COMMAND,
    CAMERA_GOAL,
    CAMERA_INFO,
    CAMERA_POSE,
    CLOUD_HEARD,
    SIM_STATE,
)
from services.camera.service import CameraService
from services.camera.settings import CameraSettings
from services.camera.warm_up import warm_up
from services.kernels.rigid import integrate_twist, look_at, pose_error
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]
DT_NS = 66_666_667
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
SCENE = SceneSpec(object="sphere", height_m=0.4, subdivide=0, deformations=(), seed=0)
START = look_at((1.1, 0.0, 0.5), (0, 0, 0.2))
GOAL = look_at((1.1, 0.05, 0.5), (0, 0, 0.2))


def state(tick: int, cameras: tuple[int, ...] = (1, 2), mode: SimMode = "lockstep") -> SimState:
    return SimState(
        t_ns=tick * DT_NS,
        tick=tick,
        frame_id="world",
        dt_ns=DT_NS,
        mode=mode,
        target=Pose.from_matrix(np.eye(4)),
        twist=STILL,
        scene=SCENE,
        cameras=[CameraBody(camera=i, pose=Pose.from_matrix(START), twist=STILL) for i in cameras],
    )


def goal(tick: int, camera: int = 2) -> CameraGoal:
    return CameraGoal(
        t_ns=tick * DT_NS,
        tick=tick,
        frame_id="world",
        camera=camera,
        pose=Pose.from_matrix(GOAL),
        twist=STILL,
    )


class World:
    """Plays simulator and planner, and hears the camera."""

    def __init__(self, open_bus: OpenBus, stack: ExitStack) -> None:
        self.bus = open_bus("simulator")
        topics = (CAMERA_CLOUD, CAMERA_COMMAND, CAMERA_POSE, CAMERA_INFO, CAMERA_COLOR)
        self.cloud, self.command, self.pose, self.info, self.color = (
            stack.enter_context(self.bus.every(topic, 2)) for topic in topics
        )

    def wait_for_the_camera(self) -> None:
        """Its first info says that it lives; then it must also have found what we publish."""
        self.info.get(timeout_s=10)
        deadline_s = time.monotonic() + 10
        pairs = ((SIM_STATE, None), (CAMERA_GOAL, 2))
        while not all(self.bus.matching(*pair) for pair in pairs):
            assert time.monotonic() < deadline_s
            threading.Event().wait(0.01)

    def tell(self, *messages: SimState | CameraGoal) -> None:
        for message in messages:
            match message:
                case SimState():
                    self.bus.publish(SIM_STATE, message)
                case CameraGoal():
                    self.bus.publish(CAMERA_GOAL, message, camera=message.camera)


@contextmanager
def camera_in(open_bus: OpenBus, **settings: object) -> Iterator[World]:
    warm_up()
    with ExitStack() as stack:
        world = World(open_bus, stack)
        loop = Loop(bus := open_bus("camera", "2"))
        chosen = CameraSettings(**{"camera": 2, "width": 160, "height": 120} | settings)
        service = CameraService(chosen, bus, loop)
        stack.enter_context(running(loop))
        world.wait_for_the_camera()
        yield world
        del service


def test_a_state_and_its_goal_give_cloud_pose_and_the_acknowledging_command(
    open_bus: OpenBus,
) -> None:
    with camera_in(open_bus, noise="ideal") as world:
        world.tell(goal(4), state(4))
        cloud = world.cloud.get(timeout_s=10).message
        assert (cloud.tick, cloud.t_ns, cloud.camera, cloud.frame_id) == (4, 4 * DT_NS, 2, "world")
        np.testing.assert_allclose(cloud.pose.matrix(), START, atol=1e-9)
        points = cloud.points_world()
        on_ground = np.abs(points[:, 2]) < 0.005
        on_sphere = np.abs(np.linalg.norm(points - [0, 0, 0.2], axis=1) - 0.2) < 0.005
        assert (on_ground | on_sphere).all()
        assert on_sphere.sum() > 1000
        pose = world.pose.get(timeout_s=10).message
        assert pose.tick == 4
        np.testing.assert_allclose(pose.pose.matrix(), START, atol=1e-9)
        command = world.command.get(timeout_s=10).message
        assert command.tick == 4
        twist = command.twist
        there = integrate_twist(START, twist.linear, twist.angular, DT_NS * 1e-9)
        assert pose_error(there, GOAL)[0] < pose_error(START, GOAL)[0]


@pytest.mark.parametrize("goal_first", [True, False])
def test_in_lockstep_each_tick_is_acknowledged_once_and_only_with_its_own_goal(
    open_bus: OpenBus, goal_first: bool
) -> None:
    with camera_in(open_bus) as world:
        world.tell(goal(6))
        for tick in range(7, 12):
            both = (goal(tick), state(tick)) if goal_first else (state(tick), goal(tick))
            world.tell(both[0])
            if not goal_first:
                assert world.cloud.get(timeout_s=10).message.tick == tick
            world.tell(both[1])
            assert world.command.get(timeout_s=10).message.tick == tick
        world.tell(goal(11))  # Said again: nothing new.
        world.tell(goal(12), state(12))
        assert world.command.get(timeout_s=10).message.tick == 12


def test_in_lockstep_a_goal_of_another_tick_moves_nobody(open_bus: OpenBus) -> None:
    with camera_in(open_bus) as world:
        world.tell(goal(3), state(4))
        assert world.cloud.get(timeout_s=10).message.tick == 4
        world.tell(state(5), goal(5))
        assert world.command.get(timeout_s=10).message.tick == 5


def test_in_real_time_the_newest_goal_serves(open_bus: OpenBus) -> None:
    with camera_in(open_bus) as world:
        world.tell(goal(3))
        acknowledged, tick = None, 10
        deadline_s = time.monotonic() + 10
        while acknowledged is None and time.monotonic() < deadline_s:
            tick += 1
            world.tell(state(tick, mode="realtime"))
            with suppress(TimeoutError):
                acknowledged = world.command.get(timeout_s=0.2).message.tick
        assert acknowledged is not None
        assert 10 < acknowledged <= tick


def test_in_real_time_what_its_mapper_has_not_heard_of_holds_back_all_but_the_newest(
    open_bus: OpenBus,
) -> None:
    def heard(tick: int) -> None:
        stamp = {"t_ns": tick * DT_NS, "tick": tick, "frame_id": "world"}
        world.bus.publish(CLOUD_HEARD, CloudHeard(**stamp, camera=2), camera=2)

    def look(tick: int) -> int | None:
        """Show a state; return the tick of the cloud that follows, if one does."""
        world.tell(state(tick, mode="realtime"))
        assert world.pose.get(timeout_s=10).message.tick == tick
        with suppress(TimeoutError):
            return world.cloud.get(timeout_s=0.5).message.tick
        return None

    with camera_in(open_bus, clouds_under_way=1) as world:
        tick = 1
        while look(tick) == tick:
            heard(0)  # Its mapper is there, and has none of these.
            tick += 1
            assert tick < 20
        assert look(tick + 1) is None
        heard(tick - 1)
        assert world.cloud.get(timeout_s=10).message.tick == tick + 1
        assert look(tick + 2) is None
        world.tell(goal(tick + 3), state(tick + 3))  # In lockstep all are sent.
        assert world.cloud.get(timeout_s=10).message.tick == tick + 3


def test_a_state_told_twice_is_answered_twice_and_drawn_once(open_bus: OpenBus) -> None:
    with camera_in(open_bus) as world:
        world.tell(goal(4), state(4))
        first = world.cloud.get(timeout_s=10).message
        assert world.command.get(timeout_s=10).message.tick == 4
        world.tell(state(4))
        assert world.cloud.get(timeout_s=10).message == first  # The shutter's time as well.
        assert world.command.get(timeout_s=10).message.tick == 4


def test_a_camera_that_is_not_in_the_world_yet_is_silent(open_bus: OpenBus) -> None:
    with camera_in(open_bus) as world:
        world.tell(goal(0), state(0, cameras=(1,)))
        world.tell(goal(1), state(1))
        assert world.command.get(timeout_s=10).message.tick == 1
        assert world.cloud.get(timeout_s=10).message.tick == 1


def test_of_the_states_that_come_while_it_renders_only_the_newest_is_drawn(
    open_bus: OpenBus,
) -> None:
    with camera_in(open_bus, width=800, height=600) as world:
        world.tell(*(state(tick) for tick in range(1, 100)))
        ticks, deadline_s = [0], time.monotonic() + 10
        while ticks[-1] < 100 and time.monotonic() < deadline_s:
            world.tell(state(100))  # Again and again: a crowded bus may drop any one.
            with suppress(TimeoutError):
                ticks.append(world.pose.get(timeout_s=0.2).message.tick)
        assert ticks == sorted(set(ticks))
        assert ticks[-1] == 100
        assert len(ticks) < 100


def test_the_same_seed_gives_the_same_cloud_in_another_process_life(open_bus: OpenBus) -> None:
    images = []
    for seed in (1, 1, 2):
        with camera_in(open_bus, seed=seed) as world:
            world.tell(state(5))
            images.append(world.cloud.get(timeout_s=10).message.array.copy())
    np.testing.assert_array_equal(images[0], images[1])
    assert (images[0] != images[2]).mean() > 0.1


def test_info_is_repeated_for_those_who_come_late(open_bus: OpenBus) -> None:
    with camera_in(open_bus, noise="d4xx") as world:
        info = world.info.get(timeout_s=10).message
        assert (info.noise, info.baseline_m, info.frame_id) == ("d4xx", 0.05, "cam_2_optical")
        assert (info.intrinsics.width, info.intrinsics.height) == (160, 120)
        assert (info.min_range_m, info.max_range_m, info.depth_scale_m) == (0.1, 5.0, 0.001)


def test_a_picture_is_published_if_colour_is_on(open_bus: OpenBus) -> None:
    with camera_in(open_bus, color=True) as world:
        deadline_s = time.monotonic() + 10
        picture, tick = None, 0
        while picture is None and time.monotonic() < deadline_s:
            tick += 1
            world.tell(state(tick))
            with suppress(TimeoutError):
                picture = world.color.get(timeout_s=0.2).message
        assert picture is not None
        image = cv2.imdecode(picture.array, cv2.IMREAD_COLOR)
        assert image.shape == (picture.height, picture.width, 3) == (120, 160, 3)
