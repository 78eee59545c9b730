"""How a camera's robot carries out its command: limits, lag, noise; flying or on wheels."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from services.kernels.rigid import FloatArray, integrate_twist, optical_yaw, rotation_exp

DriveKind = Literal["flying", "unicycle", "planned"]
"""planned: each robot as its body says, which may change."""

_STREAM = 0xAC7
"""Keeps this noise apart from that of the same camera's sensor."""
_SLACK = 0.1
"""Share of a command's speed that may point sideways: it is a tick old when time is real."""
_SLACK_M_S = 1e-3


@dataclass(frozen=True)
class Actuator:
    """What all robots can do."""

    speed_m_s: float
    turn_rad_s: float
    drive: DriveKind = "flying"
    lag_s: float = 0.0
    """Time constant with which a velocity follows its command."""
    noise_m_s: float = 0.0
    """Standard deviation of slip or gusts, per axis, anew at each tick."""
    noise_rad_s: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Body:
    """One camera in the world."""

    T_world_camera: FloatArray
    """(4, 4), optical frame."""
    twist: FloatArray
    """(6,) how its actuator moves it, without the noise: linear m/s, angular rad/s, world axes."""
    camera_yaw_rad: float = 0.0
    """How the camera is turned against the heading of its robot, if that has wheels."""
    on_wheels: bool = False
    """Whether it drives, where the actuator leaves it open."""

    def heading(self) -> FloatArray:
        """Return (3,) the way in which wheels take it."""
        phi = optical_yaw(self.T_world_camera) - self.camera_yaw_rad
        return np.array([np.cos(phi), np.sin(phi), 0.0])


@dataclass(frozen=True)
class Step:
    """What a robot did in a tick."""

    body: Body
    clipped: bool
    """The command was above the limits."""
    sideways: bool
    """The command had a part that wheels cannot do; it was left out."""


def carried_out(
    actuator: Actuator, body: Body, command: FloatArray, camera: int, tick: int, dt_s: float
) -> Step:
    """Move a robot for one tick.

    Args:
        actuator: of the robot.
        body: where it is.
        command: (6,) linear m/s and angular rad/s, world axes.
        camera: its index; with the tick it seeds the noise.
        tick: the one that ends.
        dt_s: duration of the tick.
    """
    wheels = actuator.drive == "unicycle" or (actuator.drive == "planned" and body.on_wheels)
    possible = _on_wheels(command, body.heading()) if wheels else command
    wanted = _within_limits(actuator, possible)
    mean, end = _lagging(body.twist, wanted, actuator.lag_s, dt_s)
    disturbed = mean + _noise(actuator, camera, tick)
    if wheels:
        T, end = _rolled(body, disturbed, end, dt_s)
    else:
        T = integrate_twist(body.T_world_camera, disturbed[:3], disturbed[3:], dt_s)
    return Step(
        replace(body, T_world_camera=T, twist=end),
        clipped=not np.array_equal(wanted, possible),
        sideways=_is_sideways(command, possible),
    )


def _on_wheels(command: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the part of a command along the heading and about the vertical."""
    along = heading * float(command[:3] @ heading)
    return np.array([*along, 0.0, 0.0, command[5]])


def _is_sideways(command: FloatArray, possible: FloatArray) -> bool:
    allowed = _SLACK_M_S + _SLACK * float(np.linalg.norm(command[:3]))
    return float(np.linalg.norm(command - possible)) > allowed


def _within_limits(actuator: Actuator, twist: FloatArray) -> FloatArray:
    linear = _shortened(twist[:3], actuator.speed_m_s)
    angular = _shortened(twist[3:], actuator.turn_rad_s)
    return np.concatenate([linear, angular])


def _lagging(
    before: FloatArray, wanted: FloatArray, lag_s: float, dt_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and last velocity of a tick of w' = (wanted - w) / lag; exact."""
    if lag_s == 0.0:
        return wanted, wanted
    left = np.exp(-dt_s / lag_s)
    gap = before - wanted
    return wanted + gap * (lag_s / dt_s * (1.0 - left)), wanted + gap * left


def _noise(actuator: Actuator, camera: int, tick: int) -> FloatArray:
    if actuator.noise_m_s == 0.0 and actuator.noise_rad_s == 0.0:
        return np.zeros(6)
    rng = np.random.default_rng([actuator.seed, _STREAM, camera, tick])
    deviation: FloatArray = np.repeat([actuator.noise_m_s, actuator.noise_rad_s], 3)
    return rng.normal(size=6) * deviation


def _rolled(
    body: Body, mean: FloatArray, end: FloatArray, dt_s: float
) -> tuple[FloatArray, FloatArray]:
    """Drive an arc with the camera fixed on the robot, above its axle; height and tilt stay.

    Returns:
        T_world_camera and the last velocity, both turned with the robot.
    """
    heading = body.heading()
    half_rad = 0.5 * float(mean[5]) * dt_s
    chord_m = float(mean[:3] @ heading) * dt_s * float(np.sinc(half_rad / np.pi))
    half = rotation_exp([0.0, 0.0, half_rad])
    turn = half @ half
    T = body.T_world_camera.copy()
    T[:3, :3] = turn @ T[:3, :3]
    T[:3, 3] += chord_m * (half @ heading)
    return T, np.concatenate([turn @ end[:3], end[3:]])


def _shortened(vector: FloatArray, limit: float) -> FloatArray:
    norm = float(np.linalg.norm(vector))
    return vector if norm <= limit else vector * (limit / norm)
