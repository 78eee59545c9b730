"""Leaves of an octree back into bricks of 8^3 voxels."""

import numpy as np
from numba import njit

from services.kernels.bricks import VOXELS
from services.kernels.linear_octree import BRICK_DEPTH, DEPTH


@njit(cache=True, error_model="numpy", nogil=True)
def decoded(code, out):  # type: ignore[no-untyped-def]
    """Write x, y, z of a Morton code."""
    out[:] = 0
    for bit in range(DEPTH):
        for axis in range(3):
            out[axis] |= (code >> (3 * bit + axis) & 1) << bit


@njit(cache=True, error_model="numpy", nogil=True)
def extent(code, depth, low, high):  # type: ignore[no-untyped-def]
    """Write the least key of all leaves and the greatest plus one; return how many bricks."""
    low[:], high[:] = 1 << DEPTH, 0
    key = np.empty(3, np.int64)
    num_bricks, last = np.int64(0), np.int64(-1)
    for n in range(code.size):
        decoded(code[n], key)
        edge = np.int64(1) << (DEPTH - depth[n])
        for axis in range(3):
            low[axis] = min(low[axis], key[axis])
            high[axis] = max(high[axis], key[axis] + edge)
        if depth[n] <= BRICK_DEPTH:
            num_bricks += np.int64(1) << 3 * (BRICK_DEPTH - depth[n])
        elif code[n] >> 9 != last:
            last = code[n] >> 9
            num_bricks += 1
    return num_bricks


@njit(cache=True, error_model="numpy", nogil=True)
def unfold(code, depth, value, unknown, first, bricks, values):  # type: ignore[no-untyped-def]
    """Write the bricks that leaves in Morton order tell of.

    Args:
        code, depth, value: (L,) leaves. unknown: the value of a voxel that is in none.
        first: (3,) the brick that becomes brick 0, 0, 0.
        bricks: (M, 3), M from `extent`; written. values: (M, 512), 64*i + 8*j + k; written.
    """
    key = np.empty(3, np.int64)
    linear = np.empty(VOXELS, np.int64)
    for n in range(VOXELS):
        decoded(np.int64(n), key)
        linear[n] = key[0] << 6 | key[1] << 3 | key[2]
    row, last = -1, np.int64(-1)
    for n in range(code.size):
        brick, d = code[n] >> 9, depth[n]
        if d > BRICK_DEPTH:
            if brick != last:
                row, last = row + 1, brick
                values[row] = unknown
                decoded(brick, key)
                bricks[row] = key - first
            begin = code[n] & 511
            for v in range(begin, begin + (1 << 3 * (DEPTH - d))):
                values[row, linear[v]] = value[n]
            continue
        for b in range(brick, brick + (np.int64(1) << 3 * (BRICK_DEPTH - d))):
            row += 1
            values[row] = value[n]
            decoded(b, key)
            bricks[row] = key - first
