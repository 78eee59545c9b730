"""How far a depth image sees, in windows of every size: tables of maxima.

OctoMap frees a voxel if *any* ray crosses it. A voxel is therefore tested against the farthest
return in a window as large as its silhouette, and a brick against the nearest and the farthest in
its whole outline. Raw depths are integers throughout: SIMD is wide.

Cells are 2x2 pixels. Level t of a table holds, at every cell, the maximum of the 2^t x 2^t cells
from there on (a "sparse table": any rectangle is the maximum of few of its entries). All arrays are
padded by cells of no effect, so that windows may reach beyond the image.
"""

import numpy as np
from numba import njit

PAD = 36
"""Cells around a table: the widest window, wherever it may be asked for."""
PIXEL_PAD = 10
"""Pixels around the image at full resolution."""
RIM_CELLS, RIM_PX = 17, 4
"""How far outside the image windows are asked for: half of the widest."""
NUM_DOUBLINGS = 6
"""Levels of a table: windows of 1 .. 32 cells."""
MOST = 65535
"""The nearest is MOST less the farthest of what is left to MOST: one table serves both."""
EXACT, EXACT_PX = 0, np.float32(2.0)
"""The level of silhouettes below 2 pixels: each voxel has a window of its own, 1 or 2 pixels wide
and high."""
NUM_EXACT = 4
"""Planes of windows of (1|2) x (1|2) pixels."""
NUM_FINE = 5
"""Levels 1 .. 4 have windows of about 2 .. 5 pixels; then come windows of WIDTHS cells."""
WIDTHS = np.array([3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 28, 32], np.int32)
"""Silhouettes wider than 64 pixels are sampled in part."""
NUM_LEVELS = NUM_FINE + len(WIDTHS)
WIDEST_PX = 6
"""At full resolution: three windows of 2 side by side."""


@njit(cache=True, error_model="numpy", nogil=True)
def level_for(pixels):  # type: ignore[no-untyped-def]
    """Return the level whose window comes closest to a width in pixels."""
    if pixels < EXACT_PX:
        return np.int32(EXACT)
    fine = np.int32(pixels - np.float32(0.5))
    if fine < NUM_FINE:
        return fine
    level = np.int32(0)
    while level + 1 < WIDTHS.size and pixels > WIDTHS[level] + WIDTHS[level + 1]:
        level += np.int32(1)
    return level + np.int32(NUM_FINE)


@njit(cache=True, error_model="numpy", nogil=True)
def cut(depth, limit, out):  # type: ignore[no-untyped-def]
    """Write the reach of every pixel, at most `limit`, into out, padded by PIXEL_PAD."""
    for v in range(depth.shape[0]):
        row, target = depth[v], out[v + PIXEL_PAD, PIXEL_PAD:]
        for u in range(row.size):
            target[u] = min(row[u], limit)


@njit(cache=True, error_model="numpy", nogil=True)
def halve(depth, limit, out):  # type: ignore[no-untyped-def]
    """Write the farthest of each 2x2 pixels, at most `limit`, into out, padded by PAD."""
    height, width = depth.shape
    for v in range(out.shape[0] - 2 * PAD):
        top, bottom = depth[2 * v], depth[min(2 * v + 1, height - 1)]
        target = out[v + PAD, PAD:]
        for u in range(width // 2):
            a = max(top[2 * u], bottom[2 * u])
            b = max(top[2 * u + 1], bottom[2 * u + 1])
            target[u] = min(max(a, b), limit)
        if width % 2 == 1:
            target[width // 2] = min(max(top[width - 1], bottom[width - 1]), limit)


@njit(cache=True, error_model="numpy", nogil=True)
def double(source, reach, out):  # type: ignore[no-untyped-def]
    """Write a table's next level: windows of 2 * `reach` cells from windows of `reach`."""
    height, width = source.shape
    for v in range(height):
        top, bottom, target = source[v], source[min(v + reach, height - 1)], out[v]
        right_top, right_bottom = top[reach:], bottom[reach:]
        for u in range(width - reach):
            target[u] = max(max(top[u], right_top[u]), max(bottom[u], right_bottom[u]))
        for u in range(max(width - reach, 0), width):
            target[u] = max(top[u], bottom[u])


@njit(cache=True, error_model="numpy", nogil=True)
def widen(source, reach, size, first, part, out):  # type: ignore[no-untyped-def]
    """Write maxima in windows of any size from those in windows of `reach` x `reach`.

    Args:
        source: (h, w) uint16. size: rows and columns of a window, each reach .. 3 * reach.
        first: row and column of `source` at which the window of out[0, 0] begins.
        part: first row and end row, first column and end column of out that are wanted.
        out: (m, n) uint16, written.
    """
    columns = part[3] - part[2]
    last_v, last_u = size[0] - reach, size[1] - reach
    middle_v, middle_u = min(reach, last_v), min(reach, last_u)
    tall = np.empty(columns + last_u, np.uint16)
    middle, right = tall[middle_u:], tall[last_u:]
    left = first[1] + part[2]
    for v in range(part[0], part[1]):
        a = source[v + first[0], left:]
        b = source[v + first[0] + middle_v, left:]
        c = source[v + first[0] + last_v, left:]
        target = out[v, part[2] :]
        for u in range(tall.size):
            tall[u] = max(a[u], max(b[u], c[u]))
        for u in range(columns):
            target[u] = max(tall[u], max(middle[u], right[u]))


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def extreme_level(span):  # type: ignore[no-untyped-def]
    """Return the last level of a table whose windows are at most `span` cells wide."""
    level = 0
    while (2 << level) <= span:
        level += 1
    return level
