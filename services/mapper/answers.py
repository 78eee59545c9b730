"""What the map answers with."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Fused(NamedTuple):
    """What one scan did."""

    num_hits: int
    """Voxels that got a hit."""
    num_returns: int
    """Pixels or points that returned."""
    num_skipped: int
    """Points that were not finite."""


class Counts(NamedTuple):
    """Voxels of the box by class."""

    unknown: int
    free: int
    occupied: int


class Voxels(NamedTuple):
    """Known voxels of one class."""

    centres_m: NDArray[np.float64]
    """(N, 3), map frame."""
    probability: NDArray[np.float64]
    """(N,) of being occupied."""


class RayHits(NamedTuple):
    """Where rays end: the first occupied voxel, or, if asked to stop there, unknown one."""

    outcome: NDArray[np.uint8]
    """(N,) class of the end voxel: 2 occupied, 0 unknown; 1 met nothing, 255 no ray."""
    points_m: NDArray[np.float64]
    """(N, 3) centre of the end voxel, map frame; NaN where there is none."""
    distance_m: NDArray[np.float64]
    """(N,) along the ray to where it enters the end voxel; inf if it met nothing, NaN if no ray."""

    @property
    def num_invalid(self) -> int:
        """Rays that are none: a direction of zero, what is not finite, origins beyond 1e6 m."""
        return int(np.count_nonzero(self.outcome == 255))
