"""A regular polygon of cameras that look at its middle."""

import numpy as np

from services.kernels.rigid import FloatArray, look_at


def ring_angles(num_cameras: int) -> FloatArray:
    """Return (N,) theta_0i = pi (2 i / N - 1), i = 1..N: angles on the circle, rad.

    They are places in the frame of the target; the heading phi_i of a camera's robot is another
    thing. Source: Lopez-Nicolas, Aranda, Mezouar, T-RO 36(1), 2020, sect. II.
    """
    angles: FloatArray = np.pi * (2 * np.arange(1, num_cameras + 1) / num_cameras - 1)
    return angles


def ring_views(
    num_cameras: int, radius_m: float, elevation_rad: float, centre_m: FloatArray
) -> list[FloatArray]:
    """Place N cameras around a centre, each looking at it.

    Args:
        num_cameras: N.
        radius_m: distance of every camera from the centre.
        elevation_rad: how far above the horizontal the centre sees its cameras.
        centre_m: (3,) in the frame of the ring.

    Returns:
        N transforms (4, 4), frame of the ring from optical frame.
    """
    level, up = radius_m * np.cos(elevation_rad), radius_m * np.sin(elevation_rad)
    arms = [
        np.array([level * np.cos(theta), level * np.sin(theta), up])
        for theta in ring_angles(num_cameras)
    ]
    return [look_at(centre_m + arm, centre_m) for arm in arms]
