"""The Shannon entropy of voxels."""

import numpy as np
from numpy.typing import NDArray

from services.kernels import classes
from services.kernels.bricks import UNKNOWN, Bricks
from services.mapper.sensor_model import LOG_ODDS_SCALE

_SHIFT = 4  # a table of 4096 entries stays in the first cache; the error is below 1e-3 bit.
_LEVELS = (np.arange(0, 65536, 1 << _SHIFT) + UNKNOWN) / LOG_ODDS_SCALE
_P = 1.0 / (1.0 + np.exp(-_LEVELS))
_BITS = (-_P * np.log2(_P) - (1 - _P) * np.log2(1 - _P)).astype(np.float32)
_BITS[0] = 1.0  # unknown.


def entropy_bits(bricks: Bricks) -> float:
    """Return the sum of the voxels' entropies; an unknown voxel has one bit."""
    return float(classes.sum_entropy(bricks, _BITS, _SHIFT))


def entropy_bits_of(log_odds: NDArray[np.int16]) -> float:
    """Return the same of an array of log-odds (1/8192; -32768 unknown), slab by slab."""
    return sum(
        float(_BITS[(slab.astype(np.int32) - UNKNOWN) >> _SHIFT].sum(dtype=np.float64))
        for slab in log_odds
    )
