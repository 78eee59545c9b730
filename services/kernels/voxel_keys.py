"""Three indices of a voxel in one number that sorts as they do."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

IntArray = NDArray[np.int64]

BITS = 21
"""Of one index; three to an int64."""
OFFSET = 1 << (BITS - 1)
"""Indices reach from -OFFSET up to, and not including, OFFSET: a million voxels to either side."""
_MASK = (1 << BITS) - 1


def pack(indices: ArrayLike) -> IntArray:
    """Return (N,) keys, none negative, of (N, 3) indices; these must be within the reach."""
    i, j, k = (np.asarray(indices, np.int64).reshape(-1, 3) + OFFSET).T
    keys: IntArray = (i << 2 * BITS) | (j << BITS) | k
    return keys


def unpack(keys: IntArray) -> IntArray:
    """Return the (N, 3) indices of (N,) keys."""
    parts = [keys >> 2 * BITS, (keys >> BITS) & _MASK, keys & _MASK]
    return np.stack(parts, axis=1) - OFFSET
