"""Returns: the voxels that the pixels of a depth image, or points, end in."""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM, VOXELS, open_brick
from services.kernels.fade import refresh
from services.kernels.marks import expand, hit_some

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
def locate_pixels(depth, limit, du, dv, corner, offset, shape, out):  # type: ignore[no-untyped-def]
    """Write the addresses that the pixels of an image end in, few of them twice; return how many.

    Args:
        depth: (H, W) uint16. limit: the last raw depth that counts as a return.
        du, dv, corner: (3,) float32, voxels per raw depth: per pixel u, per v, at pixel (0, 0).
        offset: (3,) float32, the camera in voxels. shape: (3,) int32, voxels of the box.
        out: (H * W + 1,) int32, written.
    """
    height, width = depth.shape
    above = np.full(width + 2 * PAD, np.int32(-1))
    here = np.full(width + 2 * PAD, np.int32(-1))
    keep = np.zeros(width, np.int32)
    count = 0
    for v in range(height):
        row = np.float32(v) * dv + corner
        row_voxels(depth[v], limit, du, row, offset, shape, here)
        first_of_neighbours(here, above, keep)
        # Written always, counted if kept: a branch here would be guessed wrong half of the time.
        for u in range(width):
            out[count] = here[u + PAD]
            count += keep[u]
        above, here = here, above
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def number_bricks(addresses, flag, flags, number, out):  # type: ignore[no-untyped-def]
    """Flag the bricks of addresses, number and list them, each once; return how many.

    Args:
        flags: (B,) uint8, written; none has the flag before. number: (B,) int32, written at them.
        out: (B,) int32, written: the bricks in the order of their numbers.
    """
    count = 0
    for n in range(addresses.size):
        brick = addresses[n] >> 9
        if flags[brick] & flag == 0:
            flags[brick] |= flag
            number[brick] = count
            out[count] = brick
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def mark_voxels(addresses, number, marks):  # type: ignore[no-untyped-def]
    """Set the bits of addressed voxels in marks (N, WORDS) uint64 of numbered bricks."""
    for n in range(addresses.size):
        brick, local = addresses[n] >> 9, addresses[n] & 511
        marks[number[brick], local >> 6] |= np.uint64(1) << np.uint64(local & 63)


@njit(cache=True, error_model="numpy", nogil=True)
def hit_bricks(bricks, listed, marks, first, end, update):  # type: ignore[no-untyped-def]
    """Add one hit to every marked voxel of listed bricks in first .. end - 1; return how many.

    Args:
        listed: (N,) int32, marks: (N, WORDS) uint64.
        update: hit, miss, low, high in 1/8192.
    """
    hit, _, low, high = update
    chosen = np.empty(VOXELS, np.int32)
    # Taken out of the tuple once: numba counts references at every access.
    slots, log_odds, dirty = bricks.slot, bricks.log_odds, bricks.dirty
    fades = bricks.clock[1] < np.inf
    count = 0
    for n in range(listed.size):
        brick = listed[n]
        if first <= brick < end:
            if fades:
                refresh(bricks, brick)
            slot = slots[brick]
            if slot == UNIFORM:
                slot = open_brick(bricks, brick)
            dirty[brick] = 1
            count += expand(marks[n], chosen)
            hit_some(log_odds[slot], chosen, hit, low, high)
    return count
