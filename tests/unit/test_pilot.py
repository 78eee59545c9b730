"""From goals to commands."""

import numpy as np
import pytest

from schemas.camera import CameraGoal
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody
from services.camera.drive import DriveLimits
from services.camera.flying import FlyingPilot
from services.kernels.rigid import integrate_twist, look_at, pose_error

pytestmark = pytest.mark.unit

DT = 1 / 15
FREE = DriveLimits(max_speed_mps=1e3, max_turn_rps=1e3, max_acceleration_mps2=1e6)
LINEAR, ANGULAR = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.4])
GOAL = look_at((1.0, 0.1, 0.5), (0, 0, 0.2))
BODY = CameraBody(
    camera=2,
    pose=Pose.from_matrix(look_at((1.2, 0.0, 0.4), (0, 0, 0.2))),
    twist=Twist(linear=(0, 0, 0), angular=(0, 0, 0)),
)


def goal(tick):
    return CameraGoal(
        t_ns=0,
        tick=tick,
        frame_id="world",
        camera=2,
        pose=Pose.from_matrix(GOAL),
        twist=Twist(linear=tuple(LINEAR), angular=tuple(ANGULAR)),
    )


def reached(tick, goal_tick):
    twist = FlyingPilot(FREE).command(BODY, tick, goal(goal_tick), DT)
    return integrate_twist(BODY.pose.matrix(), twist.linear, twist.angular, DT)


@pytest.mark.parametrize("lag", [-2, 0, 1, 5])
def test_the_command_leads_to_where_the_goal_will_be_however_old_it_is(lag):
    expected = integrate_twist(GOAL, LINEAR, ANGULAR, lag * DT)
    metres, radians = pose_error(reached(20 + lag, 20), expected)
    assert metres < 1e-9
    assert radians < 1e-7


def test_a_goal_that_is_never_renewed_comes_to_a_stand():
    last = integrate_twist(GOAL, LINEAR, ANGULAR, 0.5)
    for lag in (8, 20, 10**9):
        metres, radians = pose_error(reached(20 + lag, 20), last)
        assert metres < 1e-9
        assert radians < 1e-7
