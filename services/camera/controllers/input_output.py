"""Input-output linearisation: a point ahead of the axle can be moved anywhere at once.

Source: De Luca, Oriolo, Vendittelli, "Control of wheeled mobile robots", RAMSETE, 2001, sect. 5.
"""

import math
from typing import Annotated

from pydantic import Field

from services.camera.controllers.controller import Gain, Gains
from services.camera.controllers.planar import Drive, PlanarError, Velocity


class InputOutputGains(Gains):
    """Gains of the input-output linearisation."""

    b_m: Annotated[float, Field(ge=0.01, le=10)] = 0.2
    """How far the point is from the axle, m."""
    k: Gain = 1.0
    """Of the point's error, 1/s."""


def input_output(error: PlanarError, reference: Drive, gains: InputOutputGains) -> Velocity:
    """Return the velocity by which the point's error e_b falls as exp(-k t).

    V = |e_b|^2 / 2, V' = -2 k V, also at rest and in pure rotation. What is divided by is b, a
    setting. In reverse the point is behind the axle, as the heading would turn around otherwise.
    """
    b = math.copysign(gains.b_m, reference.v_mps)
    c, s = math.cos(error.phi_rad), math.sin(error.phi_rad)
    ahead_m, aside_m = error.x_m + b * (c - 1.0), error.y_m + b * s
    swing_mps = b * reference.omega_rps
    v = reference.v_mps * c - swing_mps * s + gains.k * ahead_m
    aside_mps = reference.v_mps * s + swing_mps * c + gains.k * aside_m
    return Velocity(v, aside_mps / b)
