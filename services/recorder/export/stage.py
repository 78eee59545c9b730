"""From where a film is seen, and by what light."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from services.kernels.rigid import FloatArray, inverse, look_at

ViewName = Literal["orbit", "sway", "still"]
_HFOV_RAD = math.radians(40)  # A long lens: little perspective.
_RING_SHARE = 0.63
"""Of the picture's width, what a ring of cameras takes."""
_SWAY_RAD = math.radians(20)
_SUN_AZIMUTH_RAD, _SUN_ELEVATION_RAD = math.radians(-75), math.radians(52)
_SUN_DISTANCES = 10.0
"""Times the scene's radius: shadows are nearly parallel."""


@dataclass(frozen=True)
class Stage:
    """How a film looks at its scene."""

    view: ViewName = "orbit"
    """Once around, to and fro, or still; an orbit and a sway end where they began."""
    azimuth_rad: float = math.radians(-90)
    elevation_rad: float = math.radians(28)
    zoom: float = 1.0

    def eye(self, centre_m: FloatArray, radius_m: float, share: float) -> FloatArray:
        """Return (4, 4) T_world_eye.

        Args:
            centre_m: (3,) what is looked at, world.
            radius_m: of what shall be seen.
            share: of the film, 0 to 1.
        """
        azimuth = self.azimuth_rad
        match self.view:
            case "orbit":
                azimuth += math.tau * share
            case "sway":
                azimuth += _SWAY_RAD * math.sin(math.tau * share)
        distance_m = radius_m / (_RING_SHARE * math.tan(_HFOV_RAD / 2)) / self.zoom
        level = math.cos(self.elevation_rad)
        arm = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(self.elevation_rad))
        return look_at(centre_m + distance_m * np.array(arm), centre_m)


def lens(width: int, height: int) -> FloatArray:
    """Return fx, fy, cx, cy, pixels, of a picture of that size."""
    focal_px = 0.5 * width / math.tan(_HFOV_RAD / 2)
    return np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2])


def sun(centre_m: FloatArray, radius_m: float, size_px: int) -> tuple[FloatArray, FloatArray]:
    """Return (4, 4) T_lamp_world and the (4,) intrinsics of a lamp that sees the whole scene."""
    level = math.cos(_SUN_ELEVATION_RAD)
    towards = np.array([
        level * math.cos(_SUN_AZIMUTH_RAD),
        level * math.sin(_SUN_AZIMUTH_RAD),
        math.sin(_SUN_ELEVATION_RAD),
    ])  # fmt: skip
    T_world_lamp = look_at(centre_m + _SUN_DISTANCES * radius_m * towards, centre_m)
    focal_px = 0.5 * size_px * _SUN_DISTANCES
    middle = (size_px - 1) / 2
    return inverse(T_world_lamp), np.array([focal_px, focal_px, middle, middle])
