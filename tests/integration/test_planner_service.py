"""The planner on a real bus: goals for every camera at every pose of the target."""

import threading
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from schemas.geometry import Pose, Twist
from schemas.target import TargetPose
from schemas.topics import CAMERA_GOAL, FORMATION, TARGET_POSE
from services.kernels.rigid import planar
from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.loop import Loop
from services.runtime.router import router
from services.runtime.settings import BusSettings

pytestmark = pytest.mark.integration

TIMEOUT_S = 5.0
DT_S = 0.1
NUM_CAMERAS = 6


@contextmanager
def running(endpoint):
    bus_settings = BusSettings(connect=endpoint, shm_pool_mib=0)
    with Bus(bus_settings, "planner") as bus:
        loop = Loop(bus)
        settings = PlannerSettings(bus=bus_settings, cameras=NUM_CAMERAS, dt_s=DT_S)
        service = PlannerService(settings, bus, loop)
        thread = threading.Thread(target=loop.run)
        thread.start()
        try:
            yield service
        finally:
            loop.stop()
            thread.join(TIMEOUT_S)


@pytest.fixture
def user():
    """A bus beside a running planner."""
    with ExitStack() as stack:
        endpoint = stack.enter_context(router())
        stack.enter_context(running(endpoint))
        bus = stack.enter_context(Bus(BusSettings(connect=endpoint, shm_pool_mib=0), "test"))
        while not bus.matching(TARGET_POSE):
            threading.Event().wait(0.01)
        yield bus


def target(tick, x_m=0.0, speed_m_s=0.5):
    return TargetPose(
        t_ns=int(tick * DT_S * 1e9),
        tick=tick,
        frame_id="world",
        pose=Pose.from_matrix(planar(x_m, 0, 0)),
        twist=Twist(linear=(speed_m_s, 0, 0), angular=(0, 0, 0)),
    )


def test_each_pose_of_the_target_brings_a_goal_for_every_camera(user):
    with user.subscribe(CAMERA_GOAL) as goals:
        user.publish(TARGET_POSE, target(7))
        received = [goals.get(TIMEOUT_S) for _ in range(NUM_CAMERAS)]
    assert sorted(each.camera for each in received) == list(range(NUM_CAMERAS))
    assert {each.message.tick for each in received} == {7}
    for each in received:
        np.testing.assert_allclose(each.message.twist.linear, [0.5, 0, 0], atol=1e-12)


def test_the_formation_is_where_the_target_will_be_at_the_next_instant(user):
    with user.subscribe(FORMATION) as formations:
        user.publish(TARGET_POSE, target(3, x_m=1.0))
        formation = formations.get(TIMEOUT_S).message
    assert formation.strategy == "circle"
    np.testing.assert_allclose(formation.centre, [1.0 + 0.5 * DT_S, 0, 0.2])
    assert len(formation.polygon) == len(formation.references) == NUM_CAMERAS


def test_the_formation_can_be_changed_while_running(user):
    changed = user.request("planner", "set", {"cameras": 3, "radius_m": 2.0}, timeout_s=TIMEOUT_S)
    assert changed == user.request("planner", "get", timeout_s=TIMEOUT_S)
    with user.subscribe(FORMATION) as formations:
        user.publish(TARGET_POSE, target(0))
        formation = formations.get(TIMEOUT_S).message
    assert len(formation.references) == 3
    assert formation.radius_m == 2.0


@pytest.mark.parametrize(
    ("params", "complaint"),
    [
        ({"cameras": 0}, "cameras = 0: .* greater than or equal to 1"),
        ({"speed": 1}, "no setting speed; known: strategy, cameras"),
        ({"strategy": "dome", "view_file": "/none"}, "/none: cannot be read"),
    ],
)
def test_a_bad_change_is_refused_and_changes_nothing(user, params, complaint):
    before = user.request("planner", "get", timeout_s=TIMEOUT_S)
    with pytest.raises(CommandFailed, match=complaint):
        user.request("planner", "set", params, timeout_s=TIMEOUT_S)
    assert user.request("planner", "get", timeout_s=TIMEOUT_S) == before
