"""Returns: the voxels that the pixels of a depth image, or points, end in."""

import numpy as np
from numba import njit

from services.kernels.bricks import add, open_brick


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def hit_voxel(bricks, slot, brick, local, scan, hit, low, high):  # type: ignore[no-untyped-def]
    """Add a hit to a voxel unless this scan already did; return whether it was added."""
    if bricks.stamp[slot, local] == scan:
        return False
    bricks.stamp[slot, local] = scan
    bricks.hit_scan[brick] = scan
    bricks.dirty[brick] = 1
    bricks.log_odds[slot, local] = np.int16(add(bricks.log_odds[slot, local], hit, low, high))
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def row_voxels(depth, limit, du, row, offset, nx, ny, nz, out):  # type: ignore[no-untyped-def]
    """Write the address (brick * 512 + voxel) that each pixel of one image row ends in, -1 for none.

    The voxel coordinates of pixel u are depth * (u * du + row) + offset; all float32 (3,).
    """
    for u in range(depth.size):
        raw = depth[u]
        z = np.float32(raw)
        uf = np.float32(u)
        x = z * (uf * du[0] + row[0]) + offset[0]
        y = z * (uf * du[1] + row[1]) + offset[1]
        w = z * (uf * du[2] + row[2]) + offset[2]
        inside = (
            (raw > 0)
            & (raw <= limit)
            & (x >= 0)
            & (y >= 0)
            & (w >= 0)
            & (x < np.float32(nx))
            & (y < np.float32(ny))
            & (w < np.float32(nz))
        )
        i, j, k = np.int32(x), np.int32(y), np.int32(w)
        brick = ((i >> 3) * (ny >> 3) + (j >> 3)) * (nz >> 3) + (k >> 3)
        address = (brick << 9) | ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)
        out[u] = address if inside else np.int32(-1)


@njit(cache=True, error_model="numpy", nogil=True)
def hit_pixels(bricks, depth, first, limit, du, dv, corner, offset, scan, hit, low, high):  # type: ignore[no-untyped-def]
    """Add one hit to every voxel that a pixel of rows first.. ends in; write `bricks` in place.

    Args:
        depth: (H, W) uint16. limit: the last raw depth that counts as a return.
        du, dv, corner: (3,) float32, voxels per raw depth, per pixel u, per pixel v, at pixel (0, 0).
        offset: (3,) float32, the camera in voxels.

    Returns:
        The row to go on with (H when done; earlier if the pool is exhausted) and the number of hits.
        A row may be repeated: a voxel is stamped by the scan that hit it.
    """
    height, width = depth.shape
    ny, nz = np.int32(bricks.shape[1] * 8), np.int32(bricks.shape[2] * 8)
    nx = np.int32(bricks.shape[0] * 8)
    above = np.full(width, np.int32(-1))
    here = np.empty(width, np.int32)
    count = 0
    for v in range(first, height):
        row = np.float32(v) * dv + corner
        row_voxels(depth[v], limit, du, row, offset, nx, ny, nz, here)
        last = np.int32(-1)
        for u in range(width):
            address = here[u]
            # Neighbouring pixels mostly end in the same voxel.
            if address == last or address == above[u] or address < 0:
                continue
            last = address
            brick = address >> 9
            slot = open_brick(bricks, brick)
            if slot < 0:
                return v, count
            count += hit_voxel(bricks, slot, brick, address & 511, scan, hit, low, high)
        above, here = here, above
    return height, count
