"""The controller of Kanayama et al., "A stable tracking control method", ICRA 1990."""

import math

from services.camera.controllers.controller import SLOWEST_MPS, Gain, Gains
from services.camera.controllers.planar import Drive, PlanarError, Velocity


class KanayamaGains(Gains):
    """Gains of Kanayama's law."""

    k_x: Gain = 1.0
    """Of the error ahead, 1/s."""
    k_y: Gain = 4.0
    """Of the error to the side, 1/m^2."""
    k_phi: Gain = 4.0
    """Of the error of heading, 1/m."""


def kanayama(error: PlanarError, reference: Drive, gains: KanayamaGains) -> Velocity:
    """Return the velocity by which V never grows.

    V = (e_x^2 + e_y^2) / 2 + (1 - cos e_phi) / k_y,
    V' = -k_x e_x^2 - |v_r| k_phi sin^2 e_phi / k_y.
    The heading's gain takes |v_r|, not v_r: V falls in reverse as well. It divides by nothing.
    """
    pace_mps = max(abs(reference.v_mps), SLOWEST_MPS)
    return Velocity(
        reference.v_mps * math.cos(error.phi_rad) + gains.k_x * error.x_m,
        reference.omega_rps
        + reference.v_mps * gains.k_y * error.y_m
        + pace_mps * gains.k_phi * math.sin(error.phi_rad),
    )
