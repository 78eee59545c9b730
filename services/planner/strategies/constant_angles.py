"""Strategy C: angles on the circle that see the target throughout at a prescribed scale.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, case 4. It needs the curvature of
the whole path in advance.
"""

import numpy as np

from services.planner.errors import InfeasibleError
from services.planner.known_motion import KnownMotion, curvature
from services.planner.planar import Slots
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.scale_bounds import angle_bounds, edge_bearing


def constant_angles(motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits) -> Slots:
    """Move each robot along the circle just as far as it must to see the target always.

    Raises:
        InfeasibleError: If no angle would do for some camera.
    """
    theta_0 = ring_angles(num_cameras)
    if limits.drive == "flying":
        return Slots(d_m, theta_0)
    view = limits.beta_rad - float(edge_bearing(limits.target_radius_m, d_m))
    lower, upper = angle_bounds(d_m, curvature(motion.target), view, theta_0)
    possible = (lower <= upper) & (view > 0)
    if not possible.all():
        names = ", ".join(f"{angle:.5g}" for angle in np.degrees(theta_0[~possible]))
        raise InfeasibleError(
            f"constant_angles, d = {d_m:g} m: theta_lower <= theta_upper is violated for the "
            f"cameras of theta_0 = {names} deg: no angle sees the target throughout"
        )
    return Slots(d_m, np.clip(theta_0, lower, upper), nominal_rad=theta_0)
