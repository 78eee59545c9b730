"""The controller of Samson (1993) with the gains of De Luca, Oriolo, Samson (1998), eq. 84."""

import math

from services.camera.controllers.controller import SLOWEST_MPS, Gain, Gains
from services.camera.controllers.planar import Drive, PlanarError, Velocity, sinc


class SamsonGains(Gains):
    """Gains of Samson's law."""

    zeta: Gain = 0.8
    """Damping of the linearised error."""
    b: Gain = 4.0
    """Stiffness, 1/m^2."""


def samson(error: PlanarError, reference: Drive, gains: SamsonGains) -> Velocity:
    """Return the velocity by which V never grows.

    V = b (e_x^2 + e_y^2) / 2 + e_phi^2 / 2, V' = -b k_1 e_x^2 - k_3 e_phi^2 with
    k_1 = k_3 = 2 zeta sqrt(omega_r^2 + b v_r^2), forwards and in reverse. It divides by nothing:
    sin(e) / e is 1 at zero.
    """
    pace_mps = max(abs(reference.v_mps), SLOWEST_MPS)
    k = 2.0 * gains.zeta * math.hypot(reference.omega_rps, math.sqrt(gains.b) * pace_mps)
    pull = gains.b * reference.v_mps * sinc(error.phi_rad) * error.y_m
    return Velocity(
        reference.v_mps * math.cos(error.phi_rad) + k * error.x_m,
        reference.omega_rps + pull + k * error.phi_rad,
    )
