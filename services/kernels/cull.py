"""The bricks that a depth image has something to say about, found without their voxels."""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM
from services.kernels.fade import is_lowest
from services.kernels.levels import EXACT, MOST, NUM_FINE, PAD, RIM_CELLS, extreme_level, level_for

PART, WHOLE = 1, 2
"""What the image says of a brick: test every voxel, or all of it is free."""
NEAR_M = np.float32(0.02)
"""Nothing nearer than this is projected."""
HIT, HIT_BY_ANY = 1, 2
"""Flags of a brick: this image, or another of the same instant, ends in it."""
_FLAT = np.float32(1e-9)


@njit(cache=True, error_model="numpy", nogil=True)
def frustum(camera, size, far, out):  # type: ignore[no-untyped-def]
    """Write six inward planes, rows n . X + d >= 0 in the camera frame, m.

    Args:
        camera: (4,) float32 fx, fy, cx, cy. size: (2,) height, width. far: m. out: (6, 4) float32.
    """
    fx, fy, cx, cy = camera
    # Windows reach half of themselves beyond the image.
    rim = np.float32(2 * RIM_CELLS)
    sides = (-(rim + cx) / fx, (size[1] + rim - cx) / fx, -(rim + cy) / fy)
    bottom = (size[0] + rim - cy) / fy
    out[:, :] = np.float32(0)
    out[0, 0], out[0, 2] = np.float32(1), -np.float32(sides[0])
    out[1, 0], out[1, 2] = np.float32(-1), np.float32(sides[1])
    out[2, 1], out[2, 2] = np.float32(1), -np.float32(sides[2])
    out[3, 1], out[3, 2] = np.float32(-1), np.float32(bottom)
    for row in range(4):
        norm = np.sqrt(out[row, 0] ** 2 + out[row, 1] ** 2 + out[row, 2] ** 2)
        for a in range(3):
            out[row, a] /= norm
    out[4, 2], out[4, 3] = np.float32(1), -NEAR_M
    out[5, 2], out[5, 3] = np.float32(-1), far


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def clip_row(planes, X, Y, Z, T, radius, count):  # type: ignore[no-untyped-def]
    """Return first and end k of bricks (X, Y, Z) + k * T[:, 2] whose spheres meet the frustum."""
    first, last = np.float32(0), np.float32(count - 1)
    for p in range(6):
        a, b, c = planes[p, 0], planes[p, 1], planes[p, 2]
        start = a * X + b * Y + c * Z + planes[p, 3] + radius
        slope = a * T[0, 2] + b * T[1, 2] + c * T[2, 2]
        if abs(slope) < _FLAT:
            if start < 0:
                last = np.float32(-1)
        elif slope > 0:
            first = max(first, -start / slope)
        else:
            last = min(last, -start / slope)
    if first > last:
        return 0, 0
    return max(int(first) - 1, 0), min(int(last) + 2, count)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def farthest_in(table, a0, a1, b0, b1):  # type: ignore[no-untyped-def]
    """Return the maximum of cells [a0, a1] x [b0, b1] (padded) from a table of maxima."""
    level = min(extreme_level(min(a1 - a0, b1 - b0) + 1), table.shape[0] - 1)
    reach = 1 << level
    found = np.uint16(0)
    a = a0
    while True:
        a = min(a, a1 + 1 - reach)
        b = b0
        while True:
            b = min(b, b1 + 1 - reach)
            found = max(found, table[level, a, b])
            if b == b1 + 1 - reach:
                break
            b += reach
        if a == a1 + 1 - reach:
            return found
        a += reach


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def nearest_in(table, a0, a1, b0, b1):  # type: ignore[no-untyped-def]
    """Return the minimum of cells [a0, a1] x [b0, b1] (padded) from a table of what is left."""
    return np.uint16(MOST - farthest_in(table, a0, a1, b0, b1))


@njit(cache=True, error_model="numpy", nogil=True)
def cull(  # type: ignore[no-untyped-def]
    bricks, T, half, camera, size, tables, windows, scale, edge, low, margin, flags, spans, out
):
    """List the bricks that the image has something to say about, in order.

    Args:
        T: (3, 4) float32, brick coordinates (bricks) to the camera frame (m).
        half: (3,) float32, half extent of a brick's bounding box in the camera frame (m).
        camera: (4,) float32 fx, fy, cx, cy. size: (2,) int64 height, width.
        tables: maxima of what the raw reach leaves to MOST, and of it, see `levels`.
        windows: (NUM_LEVELS, 2) rows and columns of every level's.
        scale: m per unit. edge: float32, m px, of a voxel's silhouette: edge / z pixels.
        low: lower clamp. margin: m. flags: (B,) uint8 of HIT and HIT_BY_ANY.
        spans: (NUM_LEVELS, 4) int32, written: of every level the first and last row, first and last
            column of pixels that voxels to be tested lie in; last < first if there are none.
        out: which (N,) int32, kind (N,) uint8, centre (N, 3) float32, level (N,) int32; written.

    Returns:
        Number of bricks to list, of which the first N are written.
    """
    left_over, maxima = tables
    which, kinds, centres, chosen = out
    nx, ny, nz = bricks.shape
    height, width = size
    fx, fy, cx, cy = camera
    rows, columns = (height + 1) >> 1, (width + 1) >> 1
    one, zero = np.float32(1), np.float32(0)
    last_u, last_v = np.float32(width - 1), np.float32(height - 1)
    centre = np.float32(0.5)
    beyond = np.float32(4 * RIM_CELLS)
    far = farthest_in(maxima, PAD, PAD + rows - 1, PAD, PAD + columns - 1) * scale
    planes = np.empty((6, 4), np.float32)
    frustum(camera, size, far, planes)
    radius = np.float32(np.sqrt(half[0] ** 2 + half[1] ** 2 + half[2] ** 2))
    # Taken out of the tuple once: numba counts references at every access.
    slots, values, fades = bricks.slot, bricks.value, bricks.clock[1] < np.inf
    spans[:, 0], spans[:, 1], spans[:, 2], spans[:, 3] = height, -1, width, -1
    count = 0
    for i in range(nx):
        for j in range(ny):
            fi, fj = np.float32(i) + centre, np.float32(j) + centre
            X0 = T[0, 0] * fi + T[0, 1] * fj + T[0, 2] * centre + T[0, 3]
            Y0 = T[1, 0] * fi + T[1, 1] * fj + T[1, 2] * centre + T[1, 3]
            Z0 = T[2, 0] * fi + T[2, 1] * fj + T[2, 2] * centre + T[2, 3]
            first, end = clip_row(planes, X0, Y0, Z0, T, radius, nz)
            for k in range(first, end):
                brick = (i * ny + j) * nz + k
                # A brick at the lower clamp stays there: no miss can change it.
                is_low = slots[brick] == UNIFORM and values[brick] == low
                if is_low and flags[brick] == 0 and (not fades or is_lowest(bricks, brick, low)):
                    continue
                fk = np.float32(k)
                X, Y, Z = X0 + T[0, 2] * fk, Y0 + T[1, 2] * fk, Z0 + T[2, 2] * fk
                if Z + half[2] <= NEAR_M or Z - half[2] + margin >= far:
                    continue
                kind, front = PART, Z - half[2]
                level = level_for(edge / max(Z, NEAR_M))
                if level == EXACT and level_for(edge / max(front, NEAR_M)) != EXACT:
                    # Its nearest voxels are too large for windows of their own.
                    level = np.int32(EXACT + 1)
                # Of a brick around the camera: everywhere, beside the image too.
                top_px, bottom_px = -2 * RIM_CELLS, int(height) + 2 * RIM_CELLS
                left_px, right_px = -2 * RIM_CELLS, int(width) + 2 * RIM_CELLS
                if front >= NEAR_M:
                    near, back = one / front, one / (Z + half[2])
                    left, right, top, bottom = X - half[0], X + half[0], Y - half[1], Y + half[1]
                    u0 = left * fx * (back if left > zero else near) + cx
                    u1 = right * fx * (near if right > zero else back) + cx
                    v0 = top * fy * (back if top > zero else near) + cy
                    v1 = bottom * fy * (near if bottom > zero else back) + cy
                    # Cells that the windows of the brick's voxels may reach.
                    down, right = windows[level, 0], windows[level, 1]
                    if level < NUM_FINE:
                        down, right = (down + 1) >> 1, (right + 1) >> 1
                    reach_v, reach_u = 1 + ((down + 1) >> 1), 1 + ((right + 1) >> 1)
                    # Kept near the image: what lies farther out is looked up nowhere.
                    top_px = int(np.floor(min(max(v0, -beyond), last_v + beyond)))
                    bottom_px = int(np.floor(min(max(v1, -beyond), last_v + beyond)))
                    left_px = int(np.floor(min(max(u0, -beyond), last_u + beyond)))
                    right_px = int(np.floor(min(max(u1, -beyond), last_u + beyond)))
                    a0, a1 = (top_px >> 1) - reach_v, (bottom_px >> 1) + reach_v
                    b0, b1 = (left_px >> 1) - reach_u, (right_px >> 1) + reach_u
                    if a1 < 0 or b1 < 0 or a0 >= rows or b0 >= columns:
                        continue
                    a0, a1 = PAD + max(a0, 0), PAD + min(a1, rows - 1)
                    b0, b1 = PAD + max(b0, 0), PAD + min(b1, columns - 1)
                    if front + margin >= farthest_in(maxima, a0, a1, b0, b1) * scale:
                        continue
                    inside = u0 >= zero and v0 >= zero and u1 <= last_u and v1 <= last_v
                    candid = inside and flags[brick] & HIT == 0
                    if candid and Z + half[2] + margin < (
                        nearest_in(left_over, a0, a1, b0, b1) * scale
                    ):
                        kind = WHOLE
                if kind == PART:
                    spans[level, 0] = min(spans[level, 0], top_px)
                    spans[level, 1] = max(spans[level, 1], bottom_px)
                    spans[level, 2] = min(spans[level, 2], left_px)
                    spans[level, 3] = max(spans[level, 3], right_px)
                if count < which.size:
                    which[count] = brick
                    kinds[count] = kind
                    centres[count, 0], centres[count, 1], centres[count, 2] = X, Y, Z
                    chosen[count] = level
                count += 1
    return count
