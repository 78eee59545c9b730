"""Exact rays: OctoMap's traversal, voxel for voxel, clipped to the box; many rays step at once.

Source: Amanatides & Woo, A Fast Voxel Traversal Algorithm for Ray Tracing, 1987, in the arithmetic
of OctoMap's `computeRayKeys` (single precision ends, double precision steps), so that both visit
the same voxels. Walking only marks one bit per voxel: rays need no order, and no brick is touched.
"""

import numpy as np
from numba import njit

NEVER = 1.7976931348623157e308
"""Step parameter along an axis the ray does not move on (OctoMap: the largest double)."""
LEAD = 3.0
"""Voxels before the box at which a ray that starts outside begins to be walked."""
LANES = 256
"""Rays that step together: their state (20 kB) stays in the first cache."""
_L = LANES
_T, _DELTA, _LENGTH = 0, 3 * _L, 6 * _L
REALS = 7 * _L
"""float64 of a block's state: next crossing x, y, z; distance between crossings; length (m)."""
_KEY, _STEP, _LEFT, _WORD = 0, 3 * _L, 6 * _L, 7 * _L
WHOLES = 8 * _L
"""int32 of a block's state: voxel x, y, z; step; voxels left; word of the mark."""


@njit(cache=True, error_model="numpy", nogil=True)
def sort_by_length(ends, origin, resolution, longest, order):  # type: ignore[no-untyped-def]
    """Write the order of rays by how many voxels they cross at most `longest`: a counting sort.

    Args:
        ends: (3, M) float32, of which the first N are rays; origin: (3,) float32, m.
        order: (N,) int32, written.
    """
    total = order.size
    steps = np.empty(total, np.int32)
    starts = np.zeros(longest + 2, np.int64)
    per_m = np.float32(1.0 / resolution)
    ox, oy, oz = origin[0], origin[1], origin[2]
    ex, ey, ez = ends[0], ends[1], ends[2]
    most = np.float32(longest)
    for n in range(total):
        span = abs(ex[n] - ox) + abs(ey[n] - oy) + abs(ez[n] - oz)
        steps[n] = np.int32(min(span * per_m, most))
    for n in range(total):
        starts[steps[n] + 1] += 1
    for s in range(longest + 1):
        starts[s + 1] += starts[s]
    for n in range(total):
        order[starts[steps[n]]] = n
        starts[steps[n]] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def enter(key, step, t_max, t_delta, shape, length, resolution):  # type: ignore[no-untyped-def]
    """Bring a ray close to the box; return how many voxels it may then cross, 0 if it misses.

    Args:
        key: (3,) int64 voxel of the box, may be outside; t_max: (3,) m; both written.
        step, t_delta, shape: (3,) direction, m per voxel, voxels of the box.
    """
    first, last = 0.0, np.float64(length) + resolution
    for a in range(3):
        if step[a] == 0:
            if key[a] < 0 or key[a] >= shape[a]:
                return 0
            continue
        # Voxel boundaries still to cross before the box, and to leave it.
        before = -key[a] if step[a] > 0 else key[a] - shape[a] + 1
        after = shape[a] - key[a] if step[a] > 0 else key[a] + 1
        if after <= 0:
            return 0
        if before > 0:
            first = max(first, t_max[a] + (before - 1) * t_delta[a])
        last = min(last, t_max[a] + (after - 1) * t_delta[a])
    if first > last + resolution:
        return 0
    start = first - LEAD * resolution
    count = np.int64(1)
    for a in range(3):
        if step[a] != 0 and t_max[a] < start:
            crossed = np.int64(np.floor((start - t_max[a]) / t_delta[a])) + 1
            key[a] += step[a] * crossed
            t_max[a] += crossed * t_delta[a]
        if step[a] != 0 and t_max[a] <= last:
            count += np.int64((last - t_max[a]) / t_delta[a]) + 2
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def start_rays(ends, chosen, origin, key0, shape, resolution, reals, wholes):  # type: ignore[no-untyped-def]
    """Write the state of a block of rays that start at the origin; return the most voxels of one.

    Args:
        ends: (3, N) float32, m; chosen: (n,) int32, which of them. origin: (3,) float32, m.
        key0, shape: (3,) int64, key of the box's first voxel, voxels of the box.
    """
    inverse = 1.0 / resolution
    start, key, step = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    t_max, t_delta = np.empty(3), np.empty(3)
    direction = np.empty(3, np.float32)
    is_outside = False
    for a in range(3):
        start[a] = np.int64(np.floor(inverse * np.float64(origin[a]))) - key0[a]
        is_outside |= start[a] < 0 or start[a] >= shape[a]
    longest = np.int64(0)
    for lane in range(chosen.size):
        squared = np.float32(0)
        crossed = np.int64(0)
        leaves = is_outside
        for a in range(3):
            end = ends[a, chosen[lane]]
            stop = np.int64(np.floor(inverse * np.float64(end))) - key0[a]
            leaves |= stop < 0 or stop >= shape[a]
            crossed += abs(stop - start[a])
            direction[a] = end - origin[a]
            squared += direction[a] * direction[a]
        length = np.float32(np.sqrt(np.float64(squared)))
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
        # A ray that ends where it starts crosses nothing (and has no direction).
        left = crossed
        if leaves and crossed > 0:
            left = min(crossed, enter(key, step, t_max, t_delta, shape, length, resolution))
        for a in range(3):
            reals[_T + a * _L + lane] = t_max[a]
            reals[_DELTA + a * _L + lane] = t_delta[a]
            wholes[_KEY + a * _L + lane] = key[a] if left > 0 else 0
            wholes[_STEP + a * _L + lane] = step[a]
        reals[_LENGTH + lane] = length
        wholes[_LEFT + lane] = left
        longest = max(longest, left)
    return longest


@njit(cache=True, error_model="numpy", nogil=True)
def step_rays(reals, wholes, bits, shape, count):  # type: ignore[no-untyped-def]
    """Write where `count` rays mark, and go one voxel further.

    All state lies in two arrays at constant distances: so LLVM knows that nothing overlaps.

    Args:
        reals, wholes: state, written. bits: (LANES,) uint64, written: the mark, 0 for none.
        shape: (3,) uint32, voxels of the box.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    nby, nbz = np.int32(ny >> 3), np.int32(nz >> 3)
    for n in range(count):
        x, y, z = wholes[_KEY + n], wholes[_KEY + _L + n], wholes[_KEY + 2 * _L + n]
        left = wholes[_LEFT + n]
        is_inside = (np.uint32(x) < nx) & (np.uint32(y) < ny) & (np.uint32(z) < nz)
        marks = is_inside & (left > 0)
        word = ((((x >> 3) * nby + (y >> 3)) * nbz + (z >> 3)) << 3) | (x & 7)
        wholes[_WORD + n] = word if marks else np.int32(0)
        bits[n] = np.uint64(marks) << np.uint64(((y & 7) << 3) | (z & 7))
        tx, ty, tz = reals[_T + n], reals[_T + _L + n], reals[_T + 2 * _L + n]
        in_x = (tx < ty) & (tx < tz)
        in_y = (ty < tz) & (not tx < ty)
        in_z = not (in_x | in_y)
        tx += reals[_DELTA + n] if in_x else 0.0
        ty += reals[_DELTA + _L + n] if in_y else 0.0
        tz += reals[_DELTA + 2 * _L + n] if in_z else 0.0
        wholes[_KEY + n] = x + (wholes[_STEP + n] if in_x else np.int32(0))
        wholes[_KEY + _L + n] = y + (wholes[_STEP + _L + n] if in_y else np.int32(0))
        wholes[_KEY + 2 * _L + n] = z + (wholes[_STEP + 2 * _L + n] if in_z else np.int32(0))
        reals[_T + n], reals[_T + _L + n], reals[_T + 2 * _L + n] = tx, ty, tz
        # Rounding may lead past the end voxel: OctoMap stops at the ray's length.
        goes_on = min(tx, min(ty, tz)) <= reals[_LENGTH + n]
        wholes[_LEFT + n] = left - np.int32(1) if goes_on else np.int32(0)


@njit(cache=True, error_model="numpy", nogil=True)
def mark(marks, wholes, bits, count):  # type: ignore[no-untyped-def]
    """Set the bits of `count` rays in marks (B * WORDS,) uint64."""
    words = wholes[_WORD:]
    for n in range(count):
        marks[words[n]] |= bits[n]


@njit(cache=True, error_model="numpy", nogil=True)
def mark_rays(marks, ends, order, origin, key0, shape, resolution):  # type: ignore[no-untyped-def]
    """Mark every voxel that a ray crosses before its end.

    Args:
        marks: (B * WORDS,) uint64, see `marks`; written.
        ends: (3, N) float32, m; order: (n,) int32, the rays to walk, alike in length if they are
            neighbours. origin: (3,) float32, m.
        key0, shape: (3,) int64, key of the box's first voxel, voxels of the box.
    """
    reals, wholes = np.zeros(REALS), np.zeros(WHOLES, np.int32)
    bits = np.zeros(LANES, np.uint64)
    size = shape.astype(np.uint32)
    for first in range(0, order.size, LANES):
        chosen = order[first : first + LANES]
        count = chosen.size
        longest = start_rays(ends, chosen, origin, key0, shape, resolution, reals, wholes)
        for _ in range(longest):
            step_rays(reals, wholes, bits, size, count)
            mark(marks, wholes, bits, count)
