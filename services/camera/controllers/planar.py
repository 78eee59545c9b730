"""A robot on the ground: where it is, how it drives, how far it is from its reference."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Posture:
    """A robot in the world; its heading phi is no angle on the circle."""

    x_m: float
    y_m: float
    phi_rad: float


@dataclass(frozen=True)
class Velocity:
    """How a unicycle drives: along its heading, and turning anticlockwise."""

    v_mps: float
    omega_rps: float


@dataclass(frozen=True)
class Drive:
    """How a reference drives, q_r' = v_r (cos phi_r, sin phi_r), phi_r' = omega_r."""

    v_mps: float
    omega_rps: float
    v_dot: float = 0.0
    """m/s^2."""


@dataclass(frozen=True)
class PlanarError:
    """Reference minus robot, in the axes of the robot."""

    x_m: float
    y_m: float
    phi_rad: float
    """(-pi, pi]."""


def error_of(robot: Posture, reference: Posture) -> PlanarError:
    """Return (e_x, e_y) = R(phi)^T (q_r - q) and e_phi = phi_r - phi."""
    dx, dy = reference.x_m - robot.x_m, reference.y_m - robot.y_m
    c, s = math.cos(robot.phi_rad), math.sin(robot.phi_rad)
    return PlanarError(
        c * dx + s * dy, -s * dx + c * dy, wrapped(reference.phi_rad - robot.phi_rad)
    )


def driven(robot: Posture, velocity: Velocity, dt_s: float) -> Posture:
    """Return where a robot is after `dt_s` (negative: was) at a constant velocity; exact arcs."""
    half_rad = 0.5 * velocity.omega_rps * dt_s
    chord_m = velocity.v_mps * dt_s * sinc(half_rad)
    direction_rad = robot.phi_rad + half_rad
    return Posture(
        robot.x_m + chord_m * math.cos(direction_rad),
        robot.y_m + chord_m * math.sin(direction_rad),
        wrapped(robot.phi_rad + 2.0 * half_rad),
    )


def wrapped(angle_rad: float) -> float:
    """Return the same angle in (-pi, pi]."""
    return -math.remainder(-angle_rad, math.tau)


def sinc(angle_rad: float) -> float:
    """Return sin(x) / x, also at zero."""
    return math.sin(angle_rad) / angle_rad if abs(angle_rad) > 1e-8 else 1.0
