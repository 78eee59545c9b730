"""Returns: the voxels that the pixels of a depth image, or points, end in."""

import numpy as np
from numba import njit

from services.kernels.bricks import add, open_brick

PAD = 2
"""Cells beside an image row, so that every pixel has neighbours."""


@njit(cache=True, error_model="numpy", nogil=True)
def count_returns(depth, invalid, no_return):  # type: ignore[no-untyped-def]
    """Count the pixels (H, W) that hold neither of two values."""
    count = np.int64(0)
    for v in range(depth.shape[0]):
        row = depth[v]
        for u in range(row.size):
            count += np.int64((row[u] != invalid) & (row[u] != no_return))
    return count


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def hit_voxel(stamp, log_odds, slot, local, scan, hit, low, high):  # type: ignore[no-untyped-def]
    """Add a hit to a voxel unless this scan already did; return 1 if it was added."""
    if stamp[slot, local] == scan:
        return 0
    stamp[slot, local] = scan
    log_odds[slot, local] = np.int16(add(log_odds[slot, local], hit, low, high))
    return 1


@njit(cache=True, error_model="numpy", nogil=True)
def row_voxels(depth, limit, du, row, offset, shape, out):  # type: ignore[no-untyped-def]
    """Write the address (brick * 512 + voxel) that each pixel of a row ends in, -1 for none.

    The voxel coordinates of pixel u are depth * (u * du + row) + offset; all float32 (3,).

    Args:
        depth: (W,) uint16. limit: the last raw depth that counts as a return.
        shape: (3,) int32, voxels of the box. out: (PAD + W + PAD,) int32, written between the pads.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    fx, fy, fz = np.float32(nx), np.float32(ny), np.float32(nz)
    dx, dy, dz = du[0], du[1], du[2]
    rx, ry, rz = row[0], row[1], row[2]
    ox, oy, oz = offset[0], offset[1], offset[2]
    by, bz = ny >> 3, nz >> 3
    for u in range(depth.size):
        raw = depth[u]
        d, uf = np.float32(raw), np.float32(np.int32(u))
        x, y, z = d * (uf * dx + rx) + ox, d * (uf * dy + ry) + oy, d * (uf * dz + rz) + oz
        inside = (x >= 0) & (y >= 0) & (z >= 0) & (x < fx) & (y < fy) & (z < fz)
        i, j, k = np.int32(x), np.int32(y), np.int32(z)
        brick = ((i >> 3) * by + (j >> 3)) * bz + (k >> 3)
        address = (brick << 9) | ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)
        out[u + PAD] = address if inside & (raw > 0) & (raw <= limit) else np.int32(-1)


@njit(cache=True, error_model="numpy", nogil=True)
def first_of_neighbours(here, above, keep):  # type: ignore[no-untyped-def]
    """Write 1 where an address differs from those of the five pixels before it: left, above.

    Neighbouring pixels mostly end in the same voxel; whoever is dropped has an equal that is not.

    Args:
        here, above: (PAD + W + PAD,) int32, two image rows. keep: (W,) int32, written.
    """
    # Shifted views: SIMD needs indices that cannot be negative.
    now, left, further = here[PAD:], here[PAD - 1 :], here[PAD - 2 :]
    top_left, top, top_right = above[PAD - 1 :], above[PAD:], above[PAD + 1 :]
    for u in range(keep.size):
        a = now[u]
        new = (a >= 0) & (a != left[u]) & (a != further[u])
        keep[u] = np.int32(new & (a != top_left[u]) & (a != top[u]) & (a != top_right[u]))


@njit(cache=True, error_model="numpy", nogil=True)
def hit_pixels(bricks, depth, first, limit, du, dv, corner, offset, scan, hit, low, high):  # type: ignore[no-untyped-def]
    """Add one hit to every voxel that a pixel of rows first.. ends in; write `bricks` in place.

    Args:
        depth: (H, W) uint16. limit: the last raw depth that counts as a return.
        du, dv, corner: (3,) float32, voxels per raw depth: per pixel u, per v, at pixel (0, 0).
        offset: (3,) float32, the camera in voxels.

    Returns:
        The row to go on with (H when done; earlier if the pool is exhausted) and the hits.
        A row may be repeated: a voxel is stamped by the scan that hit it.
    """
    height, width = depth.shape
    shape = (bricks.shape * 8).astype(np.int32)
    above = np.full(width + 2 * PAD, np.int32(-1))
    here = np.full(width + 2 * PAD, np.int32(-1))
    keep = np.zeros(width, np.int32)
    kept = np.empty(width + 1, np.int32)
    # Taken out of the tuple once: numba counts references at every access.
    slots, stamp, log_odds = bricks.slot, bricks.stamp, bricks.log_odds
    hit_scan, dirty = bricks.hit_scan, bricks.dirty
    count = 0
    for v in range(first, height):
        row = np.float32(v) * dv + corner
        row_voxels(depth[v], limit, du, row, offset, shape, here)
        first_of_neighbours(here, above, keep)
        # Written always, counted if kept: a branch here would be guessed wrong half of the time.
        num_kept = 0
        for u in range(width):
            kept[num_kept] = here[u + PAD]
            num_kept += keep[u]
        for n in range(num_kept):
            address = kept[n]
            brick = address >> 9
            slot = slots[brick]
            if slot < 0:
                slot = open_brick(bricks, brick)
                if slot < 0:
                    return v, count
            hit_scan[brick] = scan
            dirty[brick] = 1
            count += hit_voxel(stamp, log_odds, slot, address & 511, scan, hit, low, high)
        above, here = here, above
    return height, count
