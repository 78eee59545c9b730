"""The pilot of a camera that flies: it holds the view itself."""

import numpy as np

from schemas.camera import CameraGoal
from schemas.geometry import Twist
from schemas.sim import CameraBody
from services.camera.drive import DriveLimits, follow
from services.camera.pilot import coast
from services.kernels.rigid import integrate_twist


class FlyingPilot:
    """Asks for the velocity that brings the camera to its view."""

    def __init__(self, limits: DriveLimits) -> None:
        self._limits = limits

    def objection(self, goal: CameraGoal) -> str | None:  # noqa: ARG002
        """Every view can be flown to."""
        return None

    def command(self, body: CameraBody, tick: int, goal: CameraGoal, dt_s: float) -> Twist:
        """Return the velocity for the time from `tick` to the next, world axes."""
        linear, angular = np.array(goal.twist.linear), np.array(goal.twist.angular)
        coasting = coast(tick, goal.tick, dt_s)
        T_world_goal = integrate_twist(goal.pose.matrix(), linear, angular, coasting.time_s)
        if coasting.stands:
            linear, angular = np.zeros(3), np.zeros(3)
        velocity = np.array(body.twist.linear)
        linear, angular = follow(
            body.pose.matrix(), velocity, T_world_goal, linear, angular, dt_s, self._limits
        )
        return Twist(linear=tuple(linear.tolist()), angular=tuple(angular.tolist()))
