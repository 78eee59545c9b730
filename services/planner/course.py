"""The coordinates in which cameras fly from formation to formation around the target."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.planner.spherical import Spherical

_LEVEL_COSINE = 1e-6
"""Of the steepest elevation that still has a rate."""
_NO_LENGTH_M = 1e-9


@dataclass(frozen=True)
class Course:
    """Range, azimuth and climb of N cameras about the centre; arrays (..., N), m and rad.

    A straight way in these keeps what must be kept. The range stays between those of start and
    end, so nobody flies into the target. The climb is range times elevation above the centre's
    level and the height itself below it, so nobody comes lower than where it begins and ends,
    and that is above the ground. Both halves meet with equal first and second derivatives.
    """

    range_m: FloatArray
    theta_rad: FloatArray
    climb_m: FloatArray

    @classmethod
    def of(cls, places: Spherical) -> "Course":
        """Return the coordinates of places."""
        above = places.range_m * places.elevation_rad
        below = places.range_m * np.sin(places.elevation_rad)
        climb = np.where(places.elevation_rad > 0, above, below)
        return cls(places.range_m, places.theta_rad, climb)

    @classmethod
    def to(cls, arms_m: FloatArray) -> "Course":
        """Return the coordinates of (..., 3) from the centre to each."""
        rest = np.zeros(arms_m.shape[:-1])
        x, y, z = np.moveaxis(arms_m, -1, 0)
        level = np.hypot(x, y)
        return cls.of(
            Spherical(np.hypot(level, z), np.arctan2(y, x), np.arctan2(z, level), rest, rest, rest)
        )

    @classmethod
    def rates_of(cls, places: Spherical) -> "Course":
        """Return the time derivatives of the coordinates, per second."""
        e, rise = places.elevation_rad, places.range_m * places.elevation_dot
        climb_dot = np.where(
            e > 0,
            places.range_dot * e + rise,
            places.range_dot * np.sin(e) + rise * np.cos(e),
        )
        return cls(places.range_dot, places.theta_dot, climb_dot)

    def places(self, rates: "Course") -> Spherical:
        """Return the places that move with these rates: `of` and `rates_of` undone."""
        range_m = np.maximum(self.range_m, _NO_LENGTH_M)
        slope, elevation = self.climb_m / range_m, self.elevation_rad
        slope_dot = (rates.climb_m - slope * rates.range_m) / range_m
        steepness = np.maximum(np.cos(elevation), _LEVEL_COSINE)
        return Spherical(
            range_m=self.range_m,
            theta_rad=self.theta_rad,
            elevation_rad=elevation,
            range_dot=rates.range_m,
            theta_dot=rates.theta_rad,
            elevation_dot=np.where(slope > 0, slope_dot, slope_dot / steepness),
        )

    def towards(self, end: "Course", turn_rad: FloatArray, share: FloatArray) -> "Course":
        """Return where straight ways are at a share of them, 0 at the start, 1 at the end.

        Args:
            end: of the ways.
            turn_rad: how far each leads around the target, by one side of it or the other.
            share: broadcasts over the others.
        """
        return Course(
            self.range_m + share * (end.range_m - self.range_m),
            self.theta_rad + share * turn_rad,
            self.climb_m + share * (end.climb_m - self.climb_m),
        )

    def arms_m(self) -> FloatArray:
        """Return (..., 3) from the centre to each, in the frame of the target."""
        elevation = self.elevation_rad
        level = self.range_m * np.cos(elevation)
        x, y = level * np.cos(self.theta_rad), level * np.sin(self.theta_rad)
        return np.stack([x, y, self.range_m * np.sin(elevation)], axis=-1)

    def farther(self, out_m: FloatArray, over: NDArray[np.bool_]) -> "Course":
        """Return the same so much farther out, with the same climb.

        Args:
            out_m: broadcasts over the others.
            over: (N,) which keep their direction instead: overhead, less elevation leads to
                another azimuth.
        """
        range_m = self.range_m + out_m
        longer = np.where(over, range_m / np.maximum(self.range_m, _NO_LENGTH_M), 1.0)
        return Course(range_m, self.theta_rad, self.climb_m * longer)

    def except_where(self, those: NDArray[np.bool_], other: "Course") -> "Course":
        """Return these, but the others for those of the (N,) cameras."""
        return Course(
            np.where(those, other.range_m, self.range_m),
            np.where(those, other.theta_rad, self.theta_rad),
            np.where(those, other.climb_m, self.climb_m),
        )

    @property
    def elevation_rad(self) -> FloatArray:
        """How far above the horizontal the centre sees each."""
        slope = self.climb_m / np.maximum(self.range_m, _NO_LENGTH_M)
        elevation: FloatArray = np.where(slope > 0, slope, np.arcsin(np.clip(slope, -1, 1)))
        return elevation

    @property
    def level_m(self) -> FloatArray:
        """(N,) distance from the vertical through the centre."""
        level: FloatArray = np.linalg.norm(self.arms_m()[..., :2], axis=-1)
        return level
