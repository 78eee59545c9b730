"""The brick store: 8^3 voxels of log-odds, held in memory only where a brick is not uniform.

A brick is either *uniform* (one value for its 512 voxels, `slot == UNIFORM`) or *open* (512 values
in a slot of the pool). Unknown and wholly free space costs one number per brick, in memory and in
time.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

BRICK = 8
"""Voxels along the edge of a brick."""
VOXELS = BRICK**3
UNKNOWN = -32768
"""Log-odds of a voxel that no ray has told anything about."""
UNIFORM = -1
"""Slot of a brick whose voxels all hold `Bricks.value`."""
SEEN = 2
CLASS_UNKNOWN, CLASS_FREE, CLASS_OCCUPIED = 0, 1, 2


class Bricks(NamedTuple):
    """The arrays of a store of B bricks and S slots; brick (i, j, k) is row (i*ny + j)*nz + k.

    Within a brick voxel (i, j, k) is element 64*i + 8*j + k.
    """

    shape: NDArray[np.int64]
    """(3,) bricks along x, y, z."""
    slot: NDArray[np.int32]
    """(B,) row of `log_odds`, or UNIFORM."""
    value: NDArray[np.int16]
    """(B,) log-odds of all voxels of a uniform brick."""
    dirty: NDArray[np.uint8]
    """(B,) 0 unless written since the classes were last published; then 1, or, where `ever_free`
    has seen that, SEEN."""
    log_odds: NDArray[np.int16]
    """(S, 512) in 1/8192."""
    free_slots: NDArray[np.int32]
    """(S,) a stack of unused slots, num_free[0] high; there is one for every brick: S = B."""
    num_free: NDArray[np.int64]
    """(2,) the stack's height, and the least it ever had."""
    clock: NDArray[np.float64]
    """(2,) the map's time and the half-life of what it knows, s; infinite: nothing fades."""
    faded: NDArray[np.float64]
    """(B,) the time up to which a brick's log-odds have faded, s."""
    expiry: NDArray[np.float64]
    """(B,) the time at which a brick's weakest voxel may have faded to unknown, s."""


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def open_brick(bricks, brick):  # type: ignore[no-untyped-def]
    """Return the slot of a brick, giving it one if it is uniform."""
    slot = bricks.slot[brick]
    if slot != UNIFORM:
        return slot
    num_free = bricks.num_free
    height = num_free[0] - 1
    slot = bricks.free_slots[height]
    num_free[0] = height
    num_free[1] = min(num_free[1], height)
    bricks.log_odds[slot, :] = bricks.value[brick]
    bricks.slot[brick] = slot
    return slot


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def close_brick(bricks, brick, value):  # type: ignore[no-untyped-def]
    """Make a brick uniform and give its slot back."""
    slot = bricks.slot[brick]
    if slot != UNIFORM:
        bricks.free_slots[bricks.num_free[0]] = slot
        bricks.num_free[0] += 1
        bricks.slot[brick] = UNIFORM
    bricks.value[brick] = value


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def add(log_odds, update, low, high):  # type: ignore[no-untyped-def]
    """Bayes in log-odds: add the update, clamp; unknown counts as even odds (OctoMap)."""
    value = np.int32(log_odds)
    prior = np.int32(0) if value == UNKNOWN else value
    return min(max(prior + np.int32(update), np.int32(low)), np.int32(high))


@njit(cache=True, error_model="numpy", nogil=True)
def miss_row(row, miss, low):  # type: ignore[no-untyped-def]
    """Add a miss to each of the 512 voxels in place; return how many stay above the lower clamp."""
    above = np.int32(0)
    lower = np.int32(low)
    for i in range(VOXELS):
        value = np.int32(row[i])
        prior = np.int32(0) if value == UNKNOWN else value
        updated = max(prior + np.int32(miss), lower)
        row[i] = np.int16(updated)
        above += np.int32(updated != lower)
    return above


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def miss_brick(bricks, brick, miss, low):  # type: ignore[no-untyped-def]
    """Add a miss to every voxel of a brick: one addition if it is uniform."""
    slot = bricks.slot[brick]
    if slot == UNIFORM:
        bricks.value[brick] = np.int16(add(bricks.value[brick], miss, low, np.int32(32767)))
    elif miss_row(bricks.log_odds[slot], miss, low) == 0:
        close_brick(bricks, brick, np.int16(low))
    bricks.dirty[brick] = 1
