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
