"""What the world has been told of every voxel's class, and how it differs from the present."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.kernels.bricks import UNIFORM, VOXELS
from services.kernels.classes import class_of

BYTES = VOXELS // 4
"""Of a brick: two bits per voxel. Byte b holds the voxels b, b + 128, b + 256, b + 384 from its low
bits up, so that packing is four streams of SIMD."""
SPREAD = 0b01010101
"""Times a class: a byte of four voxels of that class."""


class Told(NamedTuple):
    """The arrays of what was told of B bricks; only those of several classes have a row of S."""

    state: NDArray[np.int32]
    """(B,) row of `packed`, or -1 - class of all voxels."""
    packed: NDArray[np.uint8]
    """(S, 128) classes."""
    free_rows: NDArray[np.int32]
    """(S,) a stack of unused rows; its height is `num_free[0]`."""
    num_free: NDArray[np.int64]
    """(1,)"""


@njit(cache=True, error_model="numpy", nogil=True)
def pack_row(row, out):  # type: ignore[no-untyped-def]
    """Write the classes of 512 log-odds into 128 bytes."""
    a, b, c, d = row[:BYTES], row[BYTES:], row[2 * BYTES :], row[3 * BYTES :]
    for i in range(BYTES):
        low = class_of(a[i]) | np.uint8(class_of(b[i]) << 2)
        high = np.uint8(class_of(c[i]) << 4) | np.uint8(class_of(d[i]) << 6)
        out[i] = low | high


@njit(cache=True, error_model="numpy", nogil=True)
def num_unlike(packed, other):  # type: ignore[no-untyped-def]
    """Count the bytes in which two rows of 128 differ."""
    count = np.int32(0)
    for i in range(BYTES):
        count += np.int32(packed[i] != other[i])
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def state_of(packed):  # type: ignore[no-untyped-def]
    """Return -1 - class if all voxels of a row of 128 bytes are of one class, else 0."""
    first = packed[0]
    unlike = np.int32(first % SPREAD != 0)
    for i in range(BYTES):
        unlike += np.int32(packed[i] != first)
    return np.int32(0) if unlike else np.int32(-1) - np.int32(first // SPREAD)


@njit(cache=True, error_model="numpy", nogil=True)
def write_rows(corner, now, before, rows, count):  # type: ignore[no-untyped-def]
    """Append i, j, k, class of the voxels in which two packed rows differ; return the new count."""
    for n in range(VOXELS):
        byte, shift = n % BYTES, 2 * (n // BYTES)
        if (now[byte] ^ before[byte]) >> shift & 3:
            rows[count, 0] = corner[0] + (n >> 6)
            rows[count, 1] = corner[1] + ((n >> 3) & 7)
            rows[count, 2] = corner[2] + (n & 7)
            rows[count, 3] = now[byte] >> shift & 3
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def tell(bricks, told, first, rows):  # type: ignore[no-untyped-def]
    """List the voxels of dirty bricks whose class is not the one told, and note it as told.

    Args:
        told: Told, of the same bricks; written, as is `bricks.dirty`.
        first: the brick to go on with. rows: (R, 4) int16 i, j, k, class; written.

    Returns:
        The brick to go on with (B when done; less when `rows` is full or `told` has no free row)
        and the rows written.
    """
    ny, nz = bricks.shape[1], bricks.shape[2]
    # Taken out of the tuples once: numba counts references at every access.
    slots, values, dirty, log_odds = bricks.slot, bricks.value, bricks.dirty, bricks.log_odds
    state, packed, free_rows, num_free = told.state, told.packed, told.free_rows, told.num_free
    now, before = np.empty(BYTES, np.uint8), np.empty(BYTES, np.uint8)
    corner = np.empty(3, np.int64)
    count = 0
    for brick in range(first, slots.size):
        if dirty[brick] == 0:
            continue
        slot, was = slots[brick], state[brick]
        if slot == UNIFORM:
            value = class_of(values[brick])
            if was == -1 - np.int32(value):
                dirty[brick] = 0
                continue
            now[:] = np.uint8(value * SPREAD)
        else:
            pack_row(log_odds[slot], now)
        if was >= 0:
            before[:] = packed[was]
        else:
            before[:] = np.uint8((-1 - was) * SPREAD)
        if num_unlike(now, before) == 0:
            dirty[brick] = 0
            continue
        becomes = state_of(now)
        if count + VOXELS > rows.shape[0] or (becomes == 0 and was < 0 and num_free[0] == 0):
            return brick, count
        dirty[brick] = 0
        if becomes < 0:
            if was >= 0:
                free_rows[num_free[0]] = was
                num_free[0] += 1
            state[brick] = becomes
        else:
            if was < 0:
                num_free[0] -= 1
                was = free_rows[num_free[0]]
                state[brick] = was
            packed[was] = now
        corner[0], corner[1], corner[2] = (
            brick // nz // ny * 8,
            brick // nz % ny * 8,
            brick % nz * 8,
        )
        count = write_rows(corner, now, before, rows, count)
    return slots.size, count
