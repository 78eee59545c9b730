"""Exact rays: OctoMap's traversal, voxel for voxel, clipped to the box.

Source: Amanatides & Woo, A Fast Voxel Traversal Algorithm for Ray Tracing, 1987, in the arithmetic
of OctoMap's `computeRayKeys` (single precision ends, double precision steps), so that both visit
the same voxels.
"""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM, VOXELS, add, open_brick
from services.kernels.hits import hit_voxel

NEVER = 1.7976931348623157e308
"""Step parameter along an axis the ray does not move on (OctoMap: the largest double)."""
LEAD = 3.0
"""Voxels before the box at which a ray that starts outside begins to be walked."""


@njit(cache=True, error_model="numpy", nogil=True)
def hit_points(  # type: ignore[no-untyped-def]
    bricks,
    points,
    origin,
    key0,
    resolution,
    discretize,
    max_range,
    scan,
    hit,
    low,
    high,
    first,
    ends,
    kept,
):
    """Add one hit to every voxel a point ends in and list the ends of the rays; write in place.

    Args:
        points: (N, 3) float32, m; discretize moves ends to voxel centres, one ray per voxel.
        origin: (3,) float32, m. key0: (3,) int64, key of the box's first voxel.
        max_range: m; farther points are cut there and hit nothing.
        first: the point to go on with. ends: (N, 3) float32, written. kept: rows of `ends` in use.

    Returns:
        The point to go on with (N when done), rows of `ends` in use, hits, points skipped.
    """
    nx, ny, nz = bricks.shape[0] * 8, bricks.shape[1] * 8, bricks.shape[2] * 8
    inverse = 1.0 / resolution
    end = np.empty(3, np.float32)
    key = np.empty(3, np.int64)
    hits, skipped = 0, 0
    reach = 2.0e9 * resolution
    for n in range(first, points.shape[0]):
        # NaN fails every comparison.
        usable = True
        for a in range(3):
            usable &= abs(points[n, a]) < reach
        if not usable:
            skipped += 1
            continue
        for a in range(3):
            key[a] = np.int64(np.floor(inverse * np.float64(points[n, a])))
            end[a] = points[n, a]
            if discretize:
                end[a] = np.float32((np.float64(key[a]) + 0.5) * resolution)
        dx, dy, dz = end[0] - origin[0], end[1] - origin[1], end[2] - origin[2]
        length = np.sqrt(np.float64(dx * dx + dy * dy + dz * dz))
        if length > max_range:
            norm, cut = np.float32(length), np.float32(max_range)
            ends[kept, 0] = origin[0] + dx / norm * cut
            ends[kept, 1] = origin[1] + dy / norm * cut
            ends[kept, 2] = origin[2] + dz / norm * cut
            kept += 1
            continue
        # OctoMap takes the key of the end it casts to, so a rounded centre counts.
        for a in range(3):
            key[a] = np.int64(np.floor(inverse * np.float64(end[a]))) - key0[a]
        i, j, k = key[0], key[1], key[2]
        if i >= 0 and j >= 0 and k >= 0 and i < nx and j < ny and k < nz:
            brick = ((i >> 3) * bricks.shape[1] + (j >> 3)) * bricks.shape[2] + (k >> 3)
            slot = open_brick(bricks, brick)
            if slot < 0:
                return n, kept, hits, skipped
            local = ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)
            bricks.hit_scan[brick] = scan
            bricks.dirty[brick] = 1
            new = hit_voxel(bricks.stamp, bricks.log_odds, slot, local, scan, hit, low, high)
            hits += new
            if discretize and not new:
                continue
        ends[kept, 0], ends[kept, 1], ends[kept, 2] = end[0], end[1], end[2]
        kept += 1
    return points.shape[0], kept, hits, skipped


@njit(cache=True, error_model="numpy", nogil=True)
def enters(key, step, t_max, t_delta, shape, length, resolution):  # type: ignore[no-untyped-def]
    """Bring a ray that starts outside close to the box; False if it ends or passes before it.

    Args:
        key: (3,) int64 voxel of the box, may be outside; t_max: (3,) m; both written.
        step, t_delta, shape: (3,) direction, m per voxel, voxels of the box.
    """
    enter, leave = 0.0, np.float64(length) + resolution
    for a in range(3):
        if step[a] == 0:
            if key[a] < 0 or key[a] >= shape[a]:
                return False
            continue
        # Voxel boundaries still to cross before the box, and to leave it.
        before = -key[a] if step[a] > 0 else key[a] - shape[a] + 1
        after = shape[a] - key[a] if step[a] > 0 else key[a] + 1
        if after <= 0:
            return False
        if before > 0:
            enter = max(enter, t_max[a] + (before - 1) * t_delta[a])
        leave = min(leave, t_max[a] + (after - 1) * t_delta[a])
    if enter > leave + resolution:
        return False
    start = enter - LEAD * resolution
    for a in range(3):
        if step[a] != 0 and t_max[a] < start:
            crossed = np.int64(np.floor((start - t_max[a]) / t_delta[a])) + 1
            key[a] += step[a] * crossed
            t_max[a] += crossed * t_delta[a]
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def miss_rays(bricks, ends, first, count, origin, key0, resolution, scan, miss, low, high):  # type: ignore[no-untyped-def]
    """Add one miss to every voxel that a ray crosses before its end, once in this scan.

    Args:
        ends: (N, 3) float32, m, of which `count` are used, from `first`. origin: (3,) float32, m.
        key0: (3,) int64, key of the box's first voxel. Writes `bricks` in place.

    Returns:
        The ray to go on with: count when done, less if the pool is exhausted.
    """
    nx, ny, nz = bricks.shape[0] * 8, bricks.shape[1] * 8, bricks.shape[2] * 8
    nby, nbz = bricks.shape[1], bricks.shape[2]
    shape = bricks.shape * 8
    inverse = 1.0 / resolution
    # Taken out of the tuple once: numba counts references at every access.
    slots, values, dirty = bricks.slot, bricks.value, bricks.dirty
    stamp, log_odds = bricks.stamp.reshape(-1), bricks.log_odds.reshape(-1)
    start, key, stop = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    step, t_max, t_delta = np.empty(3, np.int64), np.empty(3), np.empty(3)
    direction = np.empty(3, np.float32)
    for a in range(3):
        start[a] = np.int64(np.floor(inverse * np.float64(origin[a]))) - key0[a]
    outside = False
    for a in range(3):
        outside |= start[a] < 0 or start[a] >= shape[a]
    for n in range(first, count):
        for a in range(3):
            stop[a] = np.int64(np.floor(inverse * np.float64(ends[n, a]))) - key0[a]
            direction[a] = ends[n, a] - origin[a]
        if stop[0] == start[0] and stop[1] == start[1] and stop[2] == start[2]:
            continue
        squared = direction[0] * direction[0] + direction[1] * direction[1]
        length = np.float32(np.sqrt(np.float64(squared + direction[2] * direction[2])))
        for a in range(3):
            direction[a] = direction[a] / length
            key[a] = start[a]
            step[a], t_max[a], t_delta[a] = 0, NEVER, NEVER
            if direction[a] != 0:
                step[a] = 1 if direction[a] > 0 else -1
                centre = (np.float64(start[a] + key0[a]) + 0.5) * resolution
                border = centre + np.float64(np.float32(step[a] * resolution * 0.5))
                t_max[a] = (border - np.float64(origin[a])) / np.float64(direction[a])
                t_delta[a] = resolution / abs(np.float64(direction[a]))
        if outside and not enters(key, step, t_max, t_delta, shape, length, resolution):
            continue
        x, y, z = key[0], key[1], key[2]
        tx, ty, tz = t_max[0], t_max[1], t_max[2]
        sx, sy, sz = step[0], step[1], step[2]
        dx, dy, dz = t_delta[0], t_delta[1], t_delta[2]
        ex, ey, ez = stop[0], stop[1], stop[2]
        # Where an axis' coordinate within a brick arrives when a step enters the next brick.
        arrive_x, arrive_y, arrive_z = 7 * (sx < 0), 7 * (sy < 0), 7 * (sz < 0)
        at, visits, crossed = 0, False, True
        while True:
            if crossed:
                # The box is made of whole bricks: it is entered and left where a brick is.
                crossed = False
                visits = x >= 0 and y >= 0 and z >= 0 and x < nx and y < ny and z < nz
                if visits:
                    brick = ((x >> 3) * nby + (y >> 3)) * nbz + (z >> 3)
                    slot = slots[brick]
                    if slot == UNIFORM:
                        # A uniform brick at the lower clamp stays there.
                        visits = values[brick] != low
                        if visits:
                            slot = open_brick(bricks, brick)
                            if slot < 0:
                                return n
                    dirty[brick] |= visits
                    at = slot * VOXELS + (((x & 7) << 6) | ((y & 7) << 3) | (z & 7))
                elif (
                    (x < 0 and sx <= 0)
                    or (y < 0 and sy <= 0)
                    or (z < 0 and sz <= 0)
                    or (x >= nx and sx >= 0)
                    or (y >= ny and sy >= 0)
                    or (z >= nz and sz >= 0)
                ):
                    break
            if visits and stamp[at] != scan:
                stamp[at] = scan
                log_odds[at] = np.int16(add(log_odds[at], miss, low, high))
            if tx < ty and tx < tz:
                x += sx
                tx += dx
                at += 64 * sx
                crossed = (x & 7) == arrive_x
            elif ty < tz and not tx < ty:
                y += sy
                ty += dy
                at += 8 * sy
                crossed = (y & 7) == arrive_y
            else:
                z += sz
                tz += dz
                at += sz
                crossed = (z & 7) == arrive_z
            if x == ex and y == ey and z == ez:
                break
            # Rounding may lead past the end voxel: OctoMap stops at the ray's length.
            if min(tx, min(ty, tz)) > length:
                break
    return count
