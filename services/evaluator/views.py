"""Views from which the surface is, or could be, looked at."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schemas.camera import Intrinsics
from services.evaluator.surface import Float32Array

FloatArray = NDArray[np.float64]

ADMISSIBLE_ELEVATIONS_RAD = (math.radians(5.0), math.radians(80.0))
"""A camera on a robot can be neither below the ground nor exactly overhead."""


@dataclass(frozen=True)
class View:
    """One camera at one instant."""

    T_target_camera: FloatArray
    """(4, 4) optical frame (x right, y down, z forward) to target."""
    intrinsics: Intrinsics
    min_range_m: float
    max_range_m: float
    """Both along the optical axis."""


def eyes(views: list[View]) -> Float32Array:
    """Return (C, 3) where the cameras are, target frame, metres."""
    return np.array([view.T_target_camera[:3, 3] for view in views], np.float32).reshape(-1, 3)


def admissible_eyes(
    centre_m: ArrayLike,
    radius_m: float,
    elevations_rad: tuple[float, float] = ADMISSIBLE_ELEVATIONS_RAD,
    num: int = 400,
) -> Float32Array:
    """Spread viewpoints evenly over a band of the sphere around the target.

    Args:
        centre_m: (3,) what the cameras look at, target frame.
        radius_m: distance to it.
        elevations_rad: lowest and highest, above the horizon.
        num: how many; 400 stand about 6 degrees apart.

    Returns:
        (num, 3) metres.

    Source: the Fibonacci lattice, Gonzalez, Math. Geosciences 42, 2010.
    """
    low, high = np.sin(elevations_rad)
    height = low + (high - low) * (np.arange(num) + 0.5) / num
    azimuth = np.arange(num) * math.pi * (3 - math.sqrt(5))
    ring = np.sqrt(1 - height**2)
    directions = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), height], axis=1)
    return np.asarray(np.asarray(centre_m) + radius_m * directions, np.float32)
