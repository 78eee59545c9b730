"""How a flying camera follows its reference view: six degrees of freedom, limited.

Without limits the camera is on its reference at the next tick. With them it comes as fast as it
may and brakes in time, so that it does not overshoot.
"""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from services.kernels.rigid import FloatArray, rotation_exp, rotation_log

# The rest of the acceleration turns the velocity towards the reference while it brakes.
_BRAKING_SHARE = 0.7


class DriveLimits(BaseModel):
    """What the camera's robot can do."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True, extra="forbid")

    max_speed_mps: Annotated[float, Field(gt=0)] = 2.0
    """Fastest the camera flies, m/s."""
    max_turn_rps: Annotated[float, Field(gt=0)] = 2.5
    """Fastest it turns, rad/s."""
    max_acceleration_mps2: Annotated[float, Field(gt=0)] = 5.0
    """Strongest change of its velocity, m/s^2."""
    gain: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the error that is made up per tick; 1 is there at the next."""


def follow(
    T_world_camera: FloatArray,
    velocity_mps: FloatArray,
    T_world_goal: FloatArray,
    goal_linear_mps: FloatArray,
    goal_angular_rps: FloatArray,
    dt_s: float,
    limits: DriveLimits,
) -> tuple[FloatArray, FloatArray]:
    """Return the twist for the next `dt_s` that brings the camera towards its reference.

    Args:
        T_world_camera: (4, 4) where the camera is.
        velocity_mps: (3,) how it moves now.
        T_world_goal: (4, 4) where the reference will be `dt_s` from now.
        goal_linear_mps: (3,) how the reference moves.
        goal_angular_rps: (3,) how it turns.
        dt_s: until the next command.
        limits: of the robot.

    Returns:
        Linear (3,) m/s and angular (3,) rad/s velocity, world axes.
    """
    # Where the reference is now, and how far the camera is from it.
    error_m = T_world_goal[:3, 3] - goal_linear_mps * dt_s - T_world_camera[:3, 3]
    closing = _closing_velocity(error_m, dt_s, limits)
    # Moving with the reference while closing in, as far as the robot can.
    wanted = _shortened(goal_linear_mps + closing, limits.max_speed_mps)
    change = _shortened(wanted - velocity_mps, limits.max_acceleration_mps2 * dt_s)
    linear = _shortened(velocity_mps + change, limits.max_speed_mps)
    # Rotations do not commute: close the gap as it is now, then turn with the reference.
    turn = rotation_exp(goal_angular_rps * dt_s)
    gap = rotation_log(turn.T @ T_world_goal[:3, :3] @ T_world_camera[:3, :3].T)
    angular = rotation_log(turn @ rotation_exp(limits.gain * gap)) / dt_s
    return linear, _shortened(angular, limits.max_turn_rps)


def _closing_velocity(error_m: FloatArray, dt_s: float, limits: DriveLimits) -> FloatArray:
    """Return the velocity relative to the reference: fast, yet able to brake in time.

    At speed s, losing b dt per tick, the camera still goes s^2 / 2b + s dt / 2.
    """
    distance_m = float(np.linalg.norm(error_m))
    if distance_m == 0.0:
        return np.zeros(3)
    step_mps = _BRAKING_SHARE * limits.max_acceleration_mps2 * dt_s
    braking_mps = step_mps * (np.sqrt(0.25 + 2.0 * distance_m / (step_mps * dt_s)) - 0.5)
    speed_mps = min(limits.gain * distance_m / dt_s, braking_mps)
    closing: FloatArray = error_m * (speed_mps / distance_m)
    return closing


def _shortened(vector: FloatArray, longest: float) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector if length <= longest else vector * (longest / length)
