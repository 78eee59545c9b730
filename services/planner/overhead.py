"""Places around a centre by range and tilt from the zenith: there azimuth has no meaning."""

from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.motion import Motion
from services.planner.rotations import exps, left_jacobians

_NO_LENGTH_M = 1e-9
_NO_SINE = 1e-6
"""So near to the nadir a tilt has no rate: the one direction that these cannot tell."""
_SERIES_RAD = 1e-2
"""Of smaller angles two terms are exact to 1e-10."""


@dataclass(frozen=True)
class Overhead:
    """N places in the frame of the target and how they move; m and rad.

    A tilt is the shortest rotation from the zenith to where the centre sees the camera: a vector
    in the horizontal plane, its length the angle from the vertical (the azimuthal equidistant
    projection of maps). It and its rate are smooth overhead, where azimuth jumps.
    """

    range_m: FloatArray
    """(N,)"""
    tilt_rad: FloatArray
    """(N, 3)"""
    range_dot: FloatArray
    tilt_dot: FloatArray

    @classmethod
    def of(cls, local: Motion, centre_m: FloatArray) -> "Overhead":
        """Return where N frames are around a centre at rest.

        With d the direction and z the angle from the zenith, the tilt is z / sin z times
        (-d_y, d_x, 0).
        """
        arms = local.T[..., :3, 3] - centre_m
        range_m = np.linalg.norm(arms, axis=-1)
        length = np.maximum(range_m, _NO_LENGTH_M)[..., None]
        d = arms / length
        range_dot = np.sum(d * local.linear, axis=-1)
        d_dot = (local.linear - range_dot[..., None] * d) / length
        stretch, growth = _stretches(d)
        across = d_dot * stretch - growth * d_dot[..., 2:] * d
        return cls(range_m, tilts_of(arms), range_dot, _quarter_turned(across))

    def towards(self, end: "Overhead", share: float, rate: float) -> "Overhead":
        """Return where straight ways are at a share of them, with both ends moving.

        Args:
            end: of the ways.
            share: 0 at the start, 1 at the end.
            rate: of the share, per second.
        """
        spans = end.range_m - self.range_m, end.tilt_rad - self.tilt_rad
        dots = end.range_dot - self.range_dot, end.tilt_dot - self.tilt_dot
        return Overhead(
            self.range_m + share * spans[0],
            self.tilt_rad + share * spans[1],
            self.range_dot + share * dots[0] + rate * spans[0],
            self.tilt_dot + share * dots[1] + rate * spans[1],
        )

    def farther(self, out_m: FloatArray, out_dot: FloatArray) -> "Overhead":
        """Return the places so much farther out, in the same directions."""
        return Overhead(
            self.range_m + out_m, self.tilt_rad, self.range_dot + out_dot, self.tilt_dot
        )

    def tilted(self, centre_m: FloatArray) -> Motion:
        """Return the target's axes, tilted and put there: their z axes lead away from the centre.

        Args:
            centre_m: (3,) in the frame of the places, at rest there.

        Returns:
            (N, 4, 4), linear and angular (N, 3); twists exact.
        """
        T = np.tile(np.eye(4), (*self.range_m.shape, 1, 1))
        T[..., :3, :3] = exps(self.tilt_rad)
        outward = T[..., :3, 2]
        T[..., :3, 3] = centre_m + self.range_m[..., None] * outward
        angular = np.einsum("nij,nj->ni", left_jacobians(self.tilt_rad), self.tilt_dot)
        turning = self.range_m[..., None] * np.cross(angular, outward)
        return Motion(T, self.range_dot[..., None] * outward + turning, angular)


def tilts_of(arms_m: FloatArray) -> FloatArray:
    """Return (..., 3) tilts, rad, of (..., 3) from the centre to each place."""
    length = np.maximum(np.linalg.norm(arms_m, axis=-1, keepdims=True), _NO_LENGTH_M)
    directions = arms_m / length
    return _quarter_turned(_stretches(directions)[0] * directions)


def directions_of(tilts_rad: FloatArray) -> FloatArray:
    """Return (..., 3) unit vectors from the centre; undoes `tilts_of`."""
    directions: FloatArray = exps(tilts_rad)[..., 2]
    return directions


def _stretches(d: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (..., 1) z / sin z, and minus its derivative by cos z."""
    sine, cosine = np.hypot(d[..., :1], d[..., 1:2]), d[..., 2:]
    angle = np.arctan2(sine, cosine)
    near = angle < _SERIES_RAD
    s = np.where(near, 1.0, np.maximum(sine, _NO_SINE))
    square = angle * angle
    stretch = np.where(near, 1 + square / 6 + 7 / 360 * square**2, angle / s)
    growth = np.where(near, 1 / 3 + 2 / 15 * square, (s - angle * cosine) / s**3)
    return stretch, growth


def _quarter_turned(vectors: FloatArray) -> FloatArray:
    """Return the zenith times (..., 3) vectors."""
    x, y = vectors[..., 0], vectors[..., 1]
    turned: FloatArray = np.stack([-y, x, np.zeros_like(x)], axis=-1)
    return turned
