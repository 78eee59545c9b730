"""What the store says: classes, changes since the last look, counts, entropy, forgetting."""

import numpy as np
from numba import njit

from services.kernels.bricks import (
    CLASS_FREE,
    CLASS_OCCUPIED,
    CLASS_UNKNOWN,
    MIXED,
    UNIFORM,
    UNKNOWN,
    VOXELS,
)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def class_of(log_odds):  # type: ignore[no-untyped-def]
    """Class of one voxel: occupied from even odds on (OctoMap)."""
    known = CLASS_OCCUPIED if log_odds >= 0 else CLASS_FREE
    return np.uint8(CLASS_UNKNOWN if log_odds == UNKNOWN else known)


@njit(cache=True, error_model="numpy", nogil=True)
def classify_row(row, out):  # type: ignore[no-untyped-def]
    """Write the classes of 512 voxels."""
    for i in range(VOXELS):
        out[i] = class_of(row[i])


@njit(cache=True, error_model="numpy", nogil=True)
def differing(now, before):  # type: ignore[no-untyped-def]
    """Count the voxels whose class differs."""
    count = np.int32(0)
    for i in range(VOXELS):
        count += np.int32(now[i] != before[i])
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def publish(bricks, published, published_value, first, rows):  # type: ignore[no-untyped-def]
    """List the voxels of dirty bricks whose class is not the published one, and publish it.

    Args:
        published: (B, 512) uint8, read only where published_value is MIXED; written.
        published_value: (B,) uint8, the class of a uniform brick or MIXED; written.
        first: the brick to go on with. rows: (R, 4) int16 i, j, k, class; written.

    Returns:
        The brick to go on with (B when done, less when `rows` is full) and rows written.
    """
    ny, nz = bricks.shape[1], bricks.shape[2]
    now = np.empty(VOXELS, np.uint8)
    count = 0
    for brick in range(first, bricks.slot.size):
        if bricks.dirty[brick] == 0:
            continue
        uniform = bricks.slot[brick] == UNIFORM
        before_value = published_value[brick]
        value = class_of(bricks.value[brick])
        if uniform and before_value == value:
            bricks.dirty[brick] = 0
            continue
        if count + VOXELS > rows.shape[0]:
            return brick, count
        bricks.dirty[brick] = 0
        before = published[brick]
        if before_value != MIXED:
            before[:] = before_value
        if uniform:
            now[:] = value
        else:
            classify_row(bricks.log_odds[bricks.slot[brick]], now)
        published_value[brick] = value if uniform else np.uint8(MIXED)
        if differing(now, before) == 0:
            continue
        k0, q = brick % nz * 8, brick // nz
        i0, j0 = q // ny * 8, q % ny * 8
        for n in range(VOXELS):
            if now[n] != before[n]:
                rows[count, 0] = i0 + (n >> 6)
                rows[count, 1] = j0 + ((n >> 3) & 7)
                rows[count, 2] = k0 + (n & 7)
                rows[count, 3] = now[n]
                count += 1
        before[:] = now
    return bricks.slot.size, count


@njit(cache=True, error_model="numpy", nogil=True)
def count_row(row):  # type: ignore[no-untyped-def]
    """Count the free and the occupied of 512 voxels."""
    occupied, unknown = np.int32(0), np.int32(0)
    for i in range(VOXELS):
        occupied += np.int32(row[i] >= 0)
        unknown += np.int32(row[i] == UNKNOWN)
    return VOXELS - occupied - unknown, occupied


@njit(cache=True, error_model="numpy", nogil=True)
def count_classes(bricks):  # type: ignore[no-untyped-def]
    """Return how many voxels are free and how many occupied."""
    free, occupied = 0, 0
    for brick in range(bricks.slot.size):
        slot = bricks.slot[brick]
        if slot != UNIFORM:
            f, o = count_row(bricks.log_odds[slot])
            free += f
            occupied += o
        elif bricks.value[brick] != UNKNOWN:
            free += VOXELS * (bricks.value[brick] < 0)
            occupied += VOXELS * (bricks.value[brick] >= 0)
    return free, occupied


@njit(cache=True, error_model="numpy", nogil=True)
def sum_entropy(bricks, table, shift):  # type: ignore[no-untyped-def]
    """Sum table[(log-odds + 32768) >> shift] over all voxels: bits."""
    total = 0.0
    for brick in range(bricks.slot.size):
        slot = bricks.slot[brick]
        if slot == UNIFORM:
            total += VOXELS * np.float64(table[(np.int32(bricks.value[brick]) - UNKNOWN) >> shift])
            continue
        row = bricks.log_odds[slot]
        for i in range(VOXELS):
            total += np.float64(table[(np.int32(row[i]) - UNKNOWN) >> shift])
    return total


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def fade(log_odds, factor, forgotten):  # type: ignore[no-untyped-def]
    """Scale one log-odds towards even odds; unknown once nearer than `forgotten`."""
    value = np.int32(np.float32(log_odds) * factor)
    gone = (log_odds == UNKNOWN) | (abs(value) < forgotten)
    return np.int16(UNKNOWN if gone else value)


@njit(cache=True, error_model="numpy", nogil=True)
def fade_row(row, factor, forgotten):  # type: ignore[no-untyped-def]
    """Fade 512 voxels in place; return how many stay known."""
    known = np.int32(0)
    for i in range(VOXELS):
        row[i] = fade(row[i], factor, forgotten)
        known += np.int32(row[i] != UNKNOWN)
    return known


@njit(cache=True, error_model="numpy", nogil=True)
def fade_bricks(bricks, factor, forgotten):  # type: ignore[no-untyped-def]
    """Fade every known voxel; a brick that knows nothing any more gives its slot back."""
    for brick in range(bricks.slot.size):
        slot = bricks.slot[brick]
        if slot == UNIFORM:
            if bricks.value[brick] != UNKNOWN:
                bricks.value[brick] = fade(bricks.value[brick], factor, forgotten)
                bricks.dirty[brick] = 1
            continue
        bricks.dirty[brick] = 1
        if fade_row(bricks.log_odds[slot], factor, forgotten) == 0:
            bricks.free_slots[bricks.num_free[0]] = slot
            bricks.num_free[0] += 1
            bricks.slot[brick] = UNIFORM
            bricks.value[brick] = UNKNOWN


@njit(cache=True, error_model="numpy", nogil=True)
def classify_points(bricks, keys, out):  # type: ignore[no-untyped-def]
    """Write the class of the voxel at every key (N, 3) int64; unknown outside the box."""
    nx, ny, nz = bricks.shape
    for n in range(keys.shape[0]):
        i, j, k = keys[n, 0], keys[n, 1], keys[n, 2]
        out[n] = CLASS_UNKNOWN
        if i < 0 or j < 0 or k < 0 or i >= nx * 8 or j >= ny * 8 or k >= nz * 8:
            continue
        brick = ((i >> 3) * ny + (j >> 3)) * nz + (k >> 3)
        slot = bricks.slot[brick]
        if slot == UNIFORM:
            out[n] = class_of(bricks.value[brick])
        else:
            out[n] = class_of(bricks.log_odds[slot, ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)])


@njit(cache=True, error_model="numpy", nogil=True)
def expand(bricks, out):  # type: ignore[no-untyped-def]
    """Write the log-odds of every voxel into out (8*nx, 8*ny, 8*nz) int16."""
    ny, nz = bricks.shape[1], bricks.shape[2]
    for brick in range(bricks.slot.size):
        k0, q = brick % nz * 8, brick // nz
        i0, j0 = q // ny * 8, q % ny * 8
        slot = bricks.slot[brick]
        for n in range(VOXELS):
            value = bricks.value[brick] if slot == UNIFORM else bricks.log_odds[slot, n]
            out[i0 + (n >> 6), j0 + ((n >> 3) & 7), k0 + (n & 7)] = value
