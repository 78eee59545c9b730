"""What color the returns in a voxel have: running means, beside the log-odds."""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM
from services.kernels.hits import PAD, row_voxels

MOST = 255
"""Pixels a mean counts; beyond, a new pixel weighs 1/255 and what was seen long ago fades out."""
UNIT = 256
"""Of a mean, per step of a color: rounding leaves it within half a step of the true mean."""


@njit(cache=True, error_model="numpy", nogil=True)
def add_colors(bricks, depth, color, limit, rays, shape, mean, count, used):  # type: ignore[no-untyped-def]
    """Add the color of every pixel that ends in an open brick to its voxel's mean, in place.

    Args:
        depth: (H, W) uint16. color: (H, W, 3) uint8. limit: the last depth that is a return.
        rays: (4, 3) float32, voxels per raw depth: per pixel u, per v, at pixel (0, 0); and the
            camera in voxels. shape: (3,) int32, voxels of the box.
        mean: (S, 512, 3) uint16 in 1/UNIT, count: (S, 512) uint8, by slot. used: (S,) uint8.
    """
    height, width = depth.shape
    ends = np.full(width + 2 * PAD, np.int32(-1))
    du, dv, corner, offset = rays[0], rays[1], rays[2], rays[3]
    for v in range(height):
        row_voxels(depth[v], limit, du, np.float32(v) * dv + corner, offset, shape, ends)
        for u in range(width):
            address = ends[u + PAD]
            if address < 0:
                continue
            slot, local = bricks.slot[address >> 9], address & 511
            if slot == UNIFORM:
                continue
            used[slot] = 1
            looks = min(np.int32(count[slot, local]) + np.int32(1), np.int32(MOST))
            count[slot, local] = looks
            for c in range(3):
                before = np.int32(mean[slot, local, c])
                off = np.int32(color[v, u, c]) * UNIT - before
                mean[slot, local, c] = before + (off + (looks >> 1)) // looks
