"""The controller of Morin and Samson, Springer Handbook of Robotics (2008), sect. 34.4.

As Lopez-Nicolas et al. use it to track an enclosing formation (IRC 2020, eq. 19-20).
"""

import math

from services.camera.controllers.controller import SLOWEST_MPS, Gain, Gains
from services.camera.controllers.planar import Drive, PlanarError, Velocity

TURN_FIRST_RAD = 1.2
"""The law holds for less than pi/2; beyond this the robot turns on the spot."""


class MorinSamsonGains(Gains):
    """Gains of the law of Morin and Samson."""

    k_r: Gain = 1.0
    """Of the error ahead, 1/m."""
    k_y: Gain = 4.0
    """Of the error to the side, 1/m^2."""
    k_phi: Gain = 4.0
    """Of the error of heading, 1/m."""


def morin_samson(error: PlanarError, reference: Drive, gains: MorinSamsonGains) -> Velocity:
    """Return the velocity by which V never grows where |phi| < `TURN_FIRST_RAD`.

    With x, y, phi the robot minus the reference in the axes of the *reference*:
    V = (x^2 + y^2 + tan^2 phi / k_y) / 2,
    V' = -k_r |v_r| (x + y tan phi)^2 - k_phi |v_r| tan^2 phi / k_y.
    The cosine that is divided by is above 0.36.
    """
    phi = -error.phi_rad
    pace_mps = max(abs(reference.v_mps), SLOWEST_MPS)
    if abs(phi) > TURN_FIRST_RAD:
        return Velocity(0.0, reference.omega_rps - gains.k_phi * pace_mps * phi)
    c, s = math.cos(phi), math.sin(phi)
    # From the robot's axes into those of the reference, which is turned by -phi against them.
    x, y = -(c * error.x_m - s * error.y_m), -(s * error.x_m + c * error.y_m)
    ahead = x + y * s / c
    turn = gains.k_y * reference.v_mps * y * c * c + gains.k_phi * pace_mps * s * c
    return Velocity(
        (reference.v_mps - gains.k_r * pace_mps * ahead) / c, reference.omega_rps - turn
    )
