"""From messages to the drive and back: which velocity a camera asks for at a tick."""

import numpy as np

from schemas.camera import CameraGoal
from schemas.geometry import Twist
from schemas.sim import CameraBody
from services.camera.drive import DriveLimits, follow
from services.kernels.rigid import integrate_twist

# A reference whose planner fell silent goes on for so long and then stands still.
_MAX_COAST_S = 0.5


def command(
    body: CameraBody, tick: int, goal: CameraGoal, dt_s: float, limits: DriveLimits
) -> Twist:
    """Return the velocity for the time from `tick` to the next.

    Args:
        body: where the camera is at `tick`.
        tick: the instant at hand.
        goal: the view to hold one tick after the goal's own; an older one is moved on by its twist.
        dt_s: between two ticks.
        limits: of the camera's robot.
    """
    linear, angular = np.array(goal.twist.linear), np.array(goal.twist.angular)
    lag_s = (tick - goal.tick) * dt_s
    coast_s = min(max(lag_s, -_MAX_COAST_S), _MAX_COAST_S)
    T_world_goal = integrate_twist(goal.pose.matrix(), linear, angular, coast_s)
    if coast_s != lag_s:
        linear, angular = np.zeros(3), np.zeros(3)
    velocity = np.array(body.twist.linear)
    linear, angular = follow(
        body.pose.matrix(), velocity, T_world_goal, linear, angular, dt_s, limits
    )
    return Twist(linear=tuple(linear.tolist()), angular=tuple(angular.tolist()))
