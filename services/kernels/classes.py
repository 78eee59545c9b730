"""What the store says: classes, counts, entropy."""

import numpy as np
from numba import njit

from services.kernels.bricks import (
    CLASS_FREE,
    CLASS_OCCUPIED,
    CLASS_UNKNOWN,
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
