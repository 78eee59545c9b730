"""Places around a centre as range, azimuth and elevation, and the views that look at it."""

from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.motion import Motion

_NO_LENGTH_M = 1e-9
"""Nearer to the centre, or to the vertical through it, there is no direction."""


@dataclass(frozen=True)
class Spherical:
    """N places in the frame of the target and how they move; arrays (N,), m and rad."""

    range_m: FloatArray
    theta_rad: FloatArray
    """Angle on the circle, from the frame's x axis; no robot's heading."""
    elevation_rad: FloatArray
    """How far above the horizontal the centre sees them."""
    range_dot: FloatArray
    theta_dot: FloatArray
    elevation_dot: FloatArray

    @classmethod
    def of(cls, local: Motion, centre_m: FloatArray) -> "Spherical":
        """Return where N frames are around a centre at rest.

        On the vertical through the centre azimuth has no rate, at the centre nothing has.
        """
        x, y, z = (local.T[..., :3, 3] - centre_m).T
        vx, vy, vz = local.linear.T
        level, length = np.hypot(x, y), np.sqrt(x * x + y * y + z * z)
        safe_level, safe_length = np.maximum(level, _NO_LENGTH_M), np.maximum(length, _NO_LENGTH_M)
        level_dot = (x * vx + y * vy) / safe_level
        return cls(
            range_m=length,
            theta_rad=np.arctan2(y, x),
            elevation_rad=np.arctan2(z, level),
            range_dot=(x * vx + y * vy + z * vz) / safe_length,
            theta_dot=(x * vy - y * vx) / safe_level**2,
            elevation_dot=(vz * level - z * level_dot) / safe_length**2,
        )

    def gazing(self, centre_m: FloatArray) -> Motion:
        """Return the N frames there that look at the centre, images upright; twists exact.

        Args:
            centre_m: (3,) in the frame of the places, at rest there.

        Returns:
            (N, 4, 4), target from optical frame; linear and angular (N, 3).
        """
        c, s = np.cos(self.theta_rad), np.sin(self.theta_rad)
        ce, se = np.cos(self.elevation_rad), np.sin(self.elevation_rad)
        zero, one = np.zeros_like(c), np.ones_like(c)
        outward = np.stack([ce * c, ce * s, se], axis=-1)
        right = np.stack([-s, c, zero], axis=-1)
        up = np.stack([-se * c, -se * s, ce], axis=-1)
        T = np.zeros((*c.shape, 4, 4))
        T[..., :3, 0], T[..., :3, 1], T[..., :3, 2] = right, -up, -outward
        T[..., :3, 3] = centre_m + self.range_m[..., None] * outward
        T[..., 3, 3] = one
        linear = (
            self.range_dot[..., None] * outward
            + (self.range_m * ce * self.theta_dot)[..., None] * right
            + (self.range_m * self.elevation_dot)[..., None] * up
        )
        # Climbing turns the camera about its own right, against the right hand's sense.
        angular = -self.elevation_dot[..., None] * right
        angular[..., 2] += self.theta_dot
        return Motion(T, linear, angular)


def resting(range_m: FloatArray, theta_rad: FloatArray, elevation_rad: FloatArray) -> Spherical:
    """Return places that do not move."""
    rest = np.zeros_like(theta_rad)
    return Spherical(range_m, theta_rad, elevation_rad, rest, rest, rest)
