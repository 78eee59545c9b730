"""Free space of a depth image: every voxel projected once, whole bricks where that suffices."""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS, close_brick, miss_brick, open_brick
from services.kernels.levels import NUM_FINE, cells_of, level_for, reach_px

PART, WHOLE = 1, 2
"""What the image says of a brick: test every voxel, or all of it is free."""
NEAR_M = np.float32(0.02)
"""Nothing nearer than this is projected."""


@njit(cache=True, error_model="numpy", nogil=True)
def cull(bricks, T, half, camera, size, tiles, edge, scan, low, margin, out):  # type: ignore[no-untyped-def]
    """List the bricks that the image has something to say about.

    Args:
        T: (3, 4) float32, brick coordinates (bricks) to the camera frame (m).
        half: (3,) float32, half extent of a brick's bounding box in the camera frame (m).
        camera: (4,) float32 fx, fy, cx, cy. size: (2,) int64 height, width.
        tiles: nearest and farthest reach (m, float32) of 8x8 pixels.
        edge: float32, a voxel's edge as windows see it: edge / z pixels.
        low: lower clamp. margin: m.
        out: which (B,) int32, kind (B,) uint8, centre (B, 3) float32, level (B,) int32; written.

    Returns:
        Number of bricks listed.
    """
    nearest, farthest = tiles
    which, kinds, centres, chosen = out
    nx, ny, nz = bricks.shape
    height, width = size
    fx, fy, cx, cy = camera
    one, zero, last_u, last_v = (
        np.float32(1),
        np.float32(0),
        np.float32(width - 1),
        np.float32(height - 1),
    )
    rim = np.float32(0.5)
    # Taken out of the tuple once: numba counts references at every access.
    slots, values, hit_scan = bricks.slot, bricks.value, bricks.hit_scan
    far = zero
    for a in range(farthest.shape[0]):
        for b in range(farthest.shape[1]):
            far = max(far, farthest[a, b])
    count = 0
    for i in range(nx):
        for j in range(ny):
            fi, fj = np.float32(i) + np.float32(0.5), np.float32(j) + np.float32(0.5)
            X0 = T[0, 0] * fi + T[0, 1] * fj + T[0, 3]
            Y0 = T[1, 0] * fi + T[1, 1] * fj + T[1, 3]
            Z0 = T[2, 0] * fi + T[2, 1] * fj + T[2, 3]
            for k in range(nz):
                fk = np.float32(k) + np.float32(0.5)
                Z = Z0 + T[2, 2] * fk
                if Z + half[2] <= NEAR_M or Z - half[2] + margin >= far:
                    continue
                brick = (i * ny + j) * nz + k
                hit = hit_scan[brick] == scan
                # A brick at the lower clamp stays there: no miss can change it.
                if not hit and slots[brick] == UNIFORM and values[brick] == low:
                    continue
                X, Y = X0 + T[0, 2] * fk, Y0 + T[1, 2] * fk
                level = level_for(edge / max(Z, NEAR_M))
                kind = PART
                front = Z - half[2]
                if front >= NEAR_M:
                    near, back = one / front, one / (Z + half[2])
                    left, right, top, bottom = X - half[0], X + half[0], Y - half[1], Y + half[1]
                    u0 = left * fx * (back if left > zero else near) + cx
                    u1 = right * fx * (near if right > zero else back) + cx
                    v0 = top * fy * (back if top > zero else near) + cy
                    v1 = bottom * fy * (near if bottom > zero else back) + cy
                    # A pixel reaches half of itself beyond its centre, also at the image's rim.
                    if u1 < -rim or v1 < -rim or u0 > last_u + rim or v0 > last_v + rim:
                        continue
                    inside = u0 >= zero and v0 >= zero and u1 <= last_u and v1 <= last_v
                    reach = reach_px(level)
                    a0, a1 = max(0, int(v0) - reach) >> 3, min(height - 1, int(v1) + reach) >> 3
                    b0, b1 = max(0, int(u0) - reach) >> 3, min(width - 1, int(u1) + reach) >> 3
                    lowest, highest = np.float32(1e9), zero
                    for a in range(a0, a1 + 1):
                        for b in range(b0, b1 + 1):
                            lowest = min(lowest, nearest[a, b])
                            highest = max(highest, farthest[a, b])
                    if front + margin >= highest:
                        continue
                    if inside and not hit and Z + half[2] + margin < lowest:
                        kind = WHOLE
                which[count] = brick
                kinds[count] = kind
                centres[count, 0], centres[count, 1], centres[count, 2] = X, Y, Z
                chosen[count] = level
                count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def project(centre, offsets, pixel, bound, shift, pitch, margin, index, depth):  # type: ignore[no-untyped-def]
    """Write for each of 512 voxels where to look in a sight, and the reach that would free it (m).

    Args:
        centre: (3,) brick, offsets: (3, 512) its voxels, camera frame, m.
        pixel: (4,) fx, fy, cx, cy in the sight's cells, bound: (2,) width, height in cells.
        shift: added before rounding down. All float32; index int32, depth float32, written.
    """
    x, y, z = centre[0], centre[1], centre[2]
    ox, oy, oz = offsets[0], offsets[1], offsets[2]
    fx, fy, cx, cy = pixel[0], pixel[1], pixel[2], pixel[3]
    width, height = bound[0], bound[1]
    never = np.float32(1e9)
    for i in range(VOXELS):
        d = z + oz[i]
        inverse = np.float32(1) / d
        u = (x + ox[i]) * fx * inverse + cx
        v = (y + oy[i]) * fy * inverse + cy
        seen = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (d > NEAR_M)
        cell = np.int32(v + shift) * pitch + np.int32(u + shift)
        index[i] = cell if seen else np.int32(0)
        depth[i] = d + margin if seen else never


@njit(cache=True, error_model="numpy", nogil=True)
def compare(sight, index, depth, free):  # type: ignore[no-untyped-def]
    """Write 1 into free where the sight reaches beyond the voxel; return how many."""
    count = np.int32(0)
    for i in range(VOXELS):
        free[i] = np.int32(depth[i] < sight[np.uint32(index[i])])
    for i in range(VOXELS):
        count += free[i]
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def spare_stamped(free, stamp, scan):  # type: ignore[no-untyped-def]
    """Clear free in place where this scan has already updated the voxel: hit beats miss."""
    for i in range(VOXELS):
        free[i] = free[i] & np.int32(stamp[i] != scan)


@njit(cache=True, error_model="numpy", nogil=True)
def miss_some(row, free, miss, low):  # type: ignore[no-untyped-def]
    """Add a miss in place where free is 1; return how many voxels are above the lower clamp."""
    above = np.int32(0)
    lower, step = np.int32(low), np.int32(miss)
    for i in range(VOXELS):
        value = np.int32(row[i])
        prior = np.int32(0) if value == UNKNOWN else value
        updated = max(prior + step, lower) if free[i] != 0 else value
        row[i] = np.int16(updated)
        above += np.int32(updated != lower)
    return above


@njit(cache=True, error_model="numpy", nogil=True)
def carve(bricks, first, count, listed, offsets, sights, camera, size, scan, miss, low, margin):  # type: ignore[no-untyped-def]
    """Free the voxels of the listed bricks that the image sees beyond; write `bricks` in place.

    Args:
        listed: what `cull` wrote.
        offsets: (3, 512) float32, voxels of a brick, camera frame, m.
        sights: reach (m, float32) in windows of 1.. pixels (N, P) and its row pitch, then in
            windows of 1.. cells of 2x2 pixels, likewise.

    Returns:
        The list index to go on with: count when done, less if the pool is exhausted.
    """
    which, kinds, centres, chosen = listed
    fine, fine_pitch, coarse, coarse_pitch = sights
    height, width = size
    index, depth = np.empty(VOXELS, np.int32), np.empty(VOXELS, np.float32)
    free = np.empty(VOXELS, np.int32)
    pixel, bound = np.empty(4, np.float32), np.empty(2, np.float32)
    half = np.float32(0.5)
    for q in range(first, count):
        brick, level = which[q], chosen[q]
        if kinds[q] == WHOLE:
            miss_brick(bricks, brick, miss, low)
            continue
        cells = cells_of(level)
        is_fine = level < NUM_FINE
        scale = np.float32(1) if is_fine else half
        pixel[0], pixel[1] = camera[0] * scale, camera[1] * scale
        pixel[2], pixel[3] = (camera[2] + half) * scale, (camera[3] + half) * scale
        bound[0], bound[1] = np.float32(width) * scale, np.float32(height) * scale
        # Windows of an even number of cells are centred on corners.
        shift = half if cells % 2 == 0 else np.float32(0)
        pitch = np.int32(fine_pitch if is_fine else coarse_pitch)
        project(centres[q], offsets, pixel, bound, shift, pitch, margin, index, depth)
        sight = fine[cells - 1] if is_fine else coarse[cells - 1]
        seen = compare(sight, index, depth, free)
        if seen == 0:
            continue
        hit = bricks.hit_scan[brick] == scan
        if seen == VOXELS and not hit:
            miss_brick(bricks, brick, miss, low)
            continue
        slot = open_brick(bricks, brick)
        if slot < 0:
            return q
        if hit:
            spare_stamped(free, bricks.stamp[slot], scan)
        bricks.dirty[brick] = 1
        if miss_some(bricks.log_odds[slot], free, miss, low) == 0:
            close_brick(bricks, brick, np.int16(low))
    return count
