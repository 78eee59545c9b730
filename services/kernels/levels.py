"""How far a depth image sees, at every footprint: sliding maxima, and tiles of 8x8 pixels.

OctoMap frees a voxel if *any* ray crosses it. A voxel that covers w pixels is therefore tested
against the farthest return in a window of w pixels around its centre. Raw depths are integers
throughout, so SIMD is wide.
"""

import numpy as np
from numba import njit

NUM_FINE = 3
"""Levels 0.. are windows of 1.. pixels; then come windows of 2.. cells of 2x2 pixels."""
NUM_COARSE = 31
"""Voxels larger than 64 pixels are sampled in part."""
TILE = 4
"""Edge of a tile in half-resolution cells: 8 pixels."""


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def level_for(pixels):  # type: ignore[no-untyped-def]
    """Return the level whose window comes closest to a width in pixels."""
    fine = max(np.int32(pixels - np.float32(0.5)), np.int32(0))
    wide = min(pixels * np.float32(0.5), np.float32(NUM_COARSE))
    coarse = np.int32(wide + np.float32(0.5)) + np.int32(NUM_FINE - 2)
    return min(fine if fine < NUM_FINE else coarse, np.int32(NUM_FINE + NUM_COARSE - 1))


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def cells_of(level):  # type: ignore[no-untyped-def]
    """Return the width of a level's window, pixels if it is fine, cells if it is coarse."""
    return level + 1 if level < NUM_FINE else level - NUM_FINE + 2


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def reach_px(level):  # type: ignore[no-untyped-def]
    """Return how far a window may reach from the centre it is asked for, pixels."""
    return 2 + (0 if level < NUM_FINE else cells_of(level))


@njit(cache=True, error_model="numpy", nogil=True)
def full(depth, limit, out):  # type: ignore[no-untyped-def]
    """Write the raw reach of every pixel into out (H, W): its depth, at most `limit`."""
    height, width = depth.shape
    for v in range(height):
        row, target = depth[v], out[v]
        for u in range(width):
            target[u] = min(row[u], limit)


@njit(cache=True, error_model="numpy", nogil=True)
def halve(depth, limit, out):  # type: ignore[no-untyped-def]
    """Write the farthest of each 2x2 pixels, at most `limit`, into out (ceil(H/2), ceil(W/2))."""
    height, width = depth.shape
    for v in range(out.shape[0]):
        top, bottom = depth[2 * v], depth[min(2 * v + 1, height - 1)]
        target = out[v]
        for u in range(width // 2):
            a = max(top[2 * u], bottom[2 * u])
            b = max(top[2 * u + 1], bottom[2 * u + 1])
            target[u] = min(max(a, b), limit)
        if width % 2 == 1:
            target[width // 2] = min(max(top[width - 1], bottom[width - 1]), limit)


@njit(cache=True, error_model="numpy", nogil=True)
def widen_to_even(source, out):  # type: ignore[no-untyped-def]
    """From windows centred on cells to windows one cell wider, centred on the cells' corners.

    Args:
        source: (h, w). out: (h+1, w+1), written; out[v, u] covers source[v-1:v+1, u-1:u+1].
    """
    height, width = source.shape
    for v in range(height + 1):
        top, bottom = source[max(v - 1, 0)], source[min(v, height - 1)]
        target = out[v]
        target[0] = max(top[0], bottom[0])
        target[width] = max(top[width - 1], bottom[width - 1])
        for u in range(1, width):
            target[u] = max(max(top[u - 1], top[u]), max(bottom[u - 1], bottom[u]))


@njit(cache=True, error_model="numpy", nogil=True)
def widen_to_odd(source, out):  # type: ignore[no-untyped-def]
    """From windows centred on corners to windows one cell wider, centred on cells.

    Args:
        source: (h+1, w+1). out: (h, w), written; out[v, u] covers source[v:v+2, u:u+2].
    """
    height, width = out.shape
    for v in range(height):
        top, bottom, target = source[v], source[v + 1], out[v]
        for u in range(width):
            target[u] = max(max(top[u], top[u + 1]), max(bottom[u], bottom[u + 1]))


@njit(cache=True, error_model="numpy", nogil=True)
def to_metres(raw, scale, out):  # type: ignore[no-untyped-def]
    """Write raw * scale into the upper left of out (float32): all levels have one row pitch."""
    for v in range(raw.shape[0]):
        row, target = raw[v], out[v]
        for u in range(raw.shape[1]):
            target[u] = np.float32(row[u]) * scale


@njit(cache=True, error_model="numpy", nogil=True)
def tiles(half, nearest, farthest):  # type: ignore[no-untyped-def]
    """Write the nearest and farthest reach of every TILE x TILE cells."""
    height, width = half.shape
    rows, columns = nearest.shape
    for a in range(rows):
        for b in range(columns):
            low, high = np.uint16(65535), np.uint16(0)
            for v in range(a * TILE, min((a + 1) * TILE, height)):
                for u in range(b * TILE, min((b + 1) * TILE, width)):
                    low, high = min(low, half[v, u]), max(high, half[v, u])
            nearest[a, b] = low
            farthest[a, b] = high
