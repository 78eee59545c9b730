"""Log-odds brought within other clamps, when a map is given another sensor model."""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def clamped(log_odds, low, high):  # type: ignore[no-untyped-def]
    """Return one log-odds value within the clamps; unknown stays unknown."""
    value = np.int32(log_odds)
    within = min(max(value, np.int32(low)), np.int32(high))
    return np.int16(UNKNOWN if value == UNKNOWN else within)


@njit(cache=True, error_model="numpy", nogil=True)
def clamp_all(bricks, low, high):  # type: ignore[no-untyped-def]
    """Bring every known voxel within low < 0 <= high, in place: no class changes."""
    for brick in range(bricks.slot.size):
        slot = bricks.slot[brick]
        if slot == UNIFORM:
            bricks.value[brick] = clamped(bricks.value[brick], low, high)
            continue
        row = bricks.log_odds[slot]
        for i in range(VOXELS):
            row[i] = clamped(row[i], low, high)
