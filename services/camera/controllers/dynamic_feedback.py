"""Dynamic feedback linearisation: with its speed as a state a unicycle is a double integrator.

Source: Oriolo, De Luca, Vendittelli, "WMR control via dynamic feedback linearization", IEEE
T-CST 10(6), 2002.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from services.camera.controllers.controller import Gain, Gains, UnicycleLimits
from services.camera.controllers.planar import Drive, PlanarError, Velocity
from services.camera.controllers.samson import SamsonGains, samson

RETURN_SHARE = 1.5
"""Hysteresis: Samson's law hands back at this many times the speed at which it took over."""


class DynamicFeedbackGains(Gains):
    """Gains of the dynamic feedback linearisation."""

    k_p: Gain = 1.0
    """Of the error of position, 1/s^2."""
    k_d: Gain = 2.0
    """Of the error of velocity, 1/s."""
    slowest_mps: Annotated[float, Field(ge=0.01, le=10)] = 0.1
    """Below this speed, where the law is singular, Samson's takes over, m/s."""
    slow: SamsonGains = SamsonGains()
    """Of Samson's law, then."""


@dataclass(frozen=True)
class Momentum:
    """The state of the compensator."""

    speed_mps: float = 0.0
    """xi, what was last commanded."""
    slow: bool = True
    """Whether Samson's law is in charge."""


def linearised(
    error: PlanarError, reference: Drive, gains: DynamicFeedbackGains, speed_mps: float
) -> tuple[float, float]:
    """Return the acceleration xi' (m/s^2) and the turn rate that make p'' = u.

    u = p_r'' + k_d (p_r' - p') + k_p (p_r - p), here in the axes of the robot.
    V = (k_p |e|^2 + |e'|^2) / 2, V' = -k_d |e'|^2.

    Args:
        error: of the robot.
        reference: how the reference drives, with its acceleration.
        gains: of the law.
        speed_mps: xi, other than zero.
    """
    c, s = math.cos(error.phi_rad), math.sin(error.phi_rad)
    along, across = reference.v_dot, reference.v_mps * reference.omega_rps
    ahead_mps, aside_mps = reference.v_mps * c - speed_mps, reference.v_mps * s
    u_ahead = along * c - across * s + gains.k_d * ahead_mps + gains.k_p * error.x_m
    u_aside = along * s + across * c + gains.k_d * aside_mps + gains.k_p * error.y_m
    return u_ahead, u_aside / speed_mps


def advance(
    error: PlanarError,
    reference: Drive,
    gains: DynamicFeedbackGains,
    momentum: Momentum,
    limits: UnicycleLimits,
    dt_s: float,
) -> tuple[Velocity, Momentum]:
    """Return the velocity for the next `dt_s` and the compensator's state after it."""
    speed_mps = momentum.speed_mps
    threshold_mps = gains.slowest_mps * (RETURN_SHARE if momentum.slow else 1.0)
    slow = abs(speed_mps) < threshold_mps
    if slow:
        wanted = samson(error, reference, gains.slow)
    else:
        acceleration, omega_rps = linearised(error, reference, gains, speed_mps)
        # The mean speed of the step, as the robot holds one speed for all of it.
        wanted = Velocity(speed_mps + 0.5 * acceleration * dt_s, omega_rps)
        speed_mps += acceleration * dt_s
    velocity = limits.clipped(wanted)
    after = limits.clipped(Velocity(velocity.v_mps if slow else speed_mps, 0.0))
    return velocity, Momentum(after.v_mps, slow)


class DynamicFeedback:
    """Remembers the compensator's state from step to step."""

    def __init__(self, gains: DynamicFeedbackGains, limits: UnicycleLimits) -> None:
        self._gains, self._limits = gains, limits
        self._momentum = Momentum()

    def steer(self, error: PlanarError, reference: Drive, dt_s: float) -> Velocity:
        """Return the velocity for the next `dt_s`, within the robot's limits."""
        velocity, self._momentum = advance(
            error, reference, self._gains, self._momentum, self._limits, dt_s
        )
        return velocity
