"""Ask the bricks along rays: OctoMap's `castRay`, in its arithmetic, clipped to the box.

Source: Amanatides & Woo, A Fast Voxel Traversal Algorithm for Ray Tracing, 1987; OctoMap's
`OccupancyOcTreeBase::castRay` (a direction in single precision, steps in double).
"""

import numpy as np
from numba import njit

from services.kernels.bricks import CLASS_FREE, CLASS_OCCUPIED, CLASS_UNKNOWN, UNIFORM, UNKNOWN
from services.kernels.rays import NEVER, enter

INVALID = 255
"""Outcome of what is no ray: not finite, out of reach, or without a direction."""
_REACH_M = 1e6


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def is_ray(origin, direction):  # type: ignore[no-untyped-def]
    """Return whether origin and direction, (3,) each, are those of a ray."""
    finite, longest = True, 0.0
    for a in range(3):
        # NaN fails every comparison.
        finite &= (abs(origin[a]) <= _REACH_M) & (abs(direction[a]) < np.inf)
        longest = max(longest, abs(direction[a]))
    return finite and longest > 0.0


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def begin(origin, direction, key0, resolution, key, step, t_max, t_delta):  # type: ignore[no-untyped-def]
    """Write the voxel a ray starts in and, per axis, its steps and the m to the next borders.

    Args:
        origin, direction: (3,) float64, m and any length. key0: (3,) int64, the box's first key.
        key, step: (3,) int64, written; key may lie outside the box. t_max, t_delta: (3,), written.
    """
    # A power of two brings any length into single precision's range and rounds nothing.
    longest = max(abs(direction[0]), max(abs(direction[1]), abs(direction[2])))
    scale = np.exp2(-np.floor(np.log2(longest)))
    squared = np.float32(0)
    for a in range(3):
        part = np.float32(direction[a] * scale)
        squared += part * part
    length = np.float32(np.sqrt(np.float64(squared)))
    for a in range(3):
        start = np.float32(origin[a])
        along = np.float32(direction[a] * scale) / length
        lattice = np.int64(np.floor(1.0 / resolution * np.float64(start)))
        key[a] = lattice - key0[a]
        step[a], t_max[a], t_delta[a] = 0, NEVER, NEVER
        if along != 0:
            step[a] = 1 if along > 0 else -1
            border = (np.float64(lattice) + 0.5) * resolution + step[a] * resolution * 0.5
            t_max[a] = (border - np.float64(start)) / np.float64(along)
            t_delta[a] = resolution / abs(np.float64(along))


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def crossings(t, delta, until, most):  # type: ignore[no-untyped-def]
    """Return how many borders, next at t and then every delta, are crossed before `until`."""
    return np.int64(0) if t > until else min(np.int64((until - t) / delta) + 1, most)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def walk(bricks, key, step, t_max, t_delta, last, stops):  # type: ignore[no-untyped-def]
    """Walk a ray to its first occupied voxel; if `stops`, at most to its first unknown one.

    Uniform bricks that do not end the ray are crossed in one step.

    Args:
        key, step: (3,) int64; key is where the ray begins and is moved to where it ends.
        t_max, t_delta: (3,) m. last: m along the ray beyond which it is given up.

    Returns:
        The class of the voxel it ends in (CLASS_FREE: it met nothing), and m to its near border.
    """
    nx, ny, nz = bricks.shape[0] * 8, bricks.shape[1] * 8, bricks.shape[2] * 8
    nby, nbz = bricks.shape[1], bricks.shape[2]
    # Taken out of the tuple once: numba counts references at every access.
    slots, values, log_odds = bricks.slot, bricks.value, bricks.log_odds
    x, y, z = key
    sx, sy, sz = step
    tx, ty, tz = t_max
    dx, dy, dz = t_delta
    # Where an axis' coordinate within a brick arrives when a step enters the next brick.
    arrive_x, arrive_y, arrive_z = 7 * (sx < 0), 7 * (sy < 0), 7 * (sz < 0)
    slot, value = np.int32(UNIFORM), np.int16(UNKNOWN)
    looks, crossed, entered, outcome = False, True, 0.0, CLASS_FREE
    while entered <= last:
        if crossed:
            crossed, looks = False, False
            if x >= 0 and y >= 0 and z >= 0 and x < nx and y < ny and z < nz:
                brick = ((x >> 3) * nby + (y >> 3)) * nbz + (z >> 3)
                slot = slots[brick]
                value = values[brick]
                looks = slot != UNIFORM or value >= 0 or (stops and value == UNKNOWN)
                if not looks:
                    left_x = (x & 7) + 1 if sx < 0 else 8 - (x & 7)
                    left_y = (y & 7) + 1 if sy < 0 else 8 - (y & 7)
                    left_z = (z & 7) + 1 if sz < 0 else 8 - (z & 7)
                    out_x, out_y = tx + (left_x - 1) * dx, ty + (left_y - 1) * dy
                    entered = min(out_x, min(out_y, tz + (left_z - 1) * dz))
                    # Where borders meet OctoMap crosses z first, then y.
                    by_z = tz + (left_z - 1) * dz == entered
                    by_y = out_y == entered and not by_z
                    by_x = not by_z and not by_y
                    n_x = left_x if by_x else crossings(tx, dx, entered, left_x - 1)
                    n_y = left_y if by_y else crossings(ty, dy, entered, left_y - 1)
                    n_z = left_z if by_z else crossings(tz, dz, entered, left_z - 1)
                    x, y, z = x + sx * n_x, y + sy * n_y, z + sz * n_z
                    tx, ty, tz = tx + n_x * dx, ty + n_y * dy, tz + n_z * dz
                    crossed = True
                    continue
            elif (
                (x < 0 and sx <= 0)
                or (y < 0 and sy <= 0)
                or (z < 0 and sz <= 0)
                or (x >= nx and sx >= 0)
                or (y >= ny and sy >= 0)
                or (z >= nz and sz >= 0)
            ):
                break
        if looks:
            if slot != UNIFORM:
                value = log_odds[slot, ((x & 7) << 6) | ((y & 7) << 3) | (z & 7)]
            if value >= 0:
                outcome = CLASS_OCCUPIED
                break
            if stops and value == UNKNOWN:
                outcome = CLASS_UNKNOWN
                break
        if tx < ty and tx < tz:
            x += sx
            entered = tx
            tx += dx
            crossed = (x & 7) == arrive_x
        elif ty < tz and not tx < ty:
            y += sy
            entered = ty
            ty += dy
            crossed = (y & 7) == arrive_y
        else:
            z += sz
            entered = tz
            tz += dz
            crossed = (z & 7) == arrive_z
    key[0], key[1], key[2] = x, y, z
    return outcome, entered


@njit(cache=True, error_model="numpy", nogil=True)
def cast(  # type: ignore[no-untyped-def]
    bricks, origins, directions, key0, resolution, max_range, stops, outcome, voxels, distance
):
    """Cast rays; a voxel is within range if its centre is (OctoMap's rule).

    Args:
        origins, directions: (N, 3) float64, m and any length. key0: (3,) int64, the box's first
            key. max_range: m, may be infinite. stops: whether unknown voxels of the box end a ray.
        outcome: (N,) uint8: class of the end voxel, CLASS_FREE if nothing was met, or INVALID.
        voxels: (N, 3) int64, the end voxel of the box. distance: (N,) m to its near border. Both
            written where a ray has ended in a voxel.
    """
    shape = bricks.shape * 8
    key, step = np.empty(3, np.int64), np.empty(3, np.int64)
    t_max, t_delta = np.empty(3), np.empty(3)
    last = max_range + resolution  # No centre is nearer than the border less half a diagonal.
    for n in range(origins.shape[0]):
        outcome[n] = INVALID
        if not is_ray(origins[n], directions[n]):
            continue
        outcome[n] = CLASS_FREE
        begin(origins[n], directions[n], key0, resolution, key, step, t_max, t_delta)
        outside = False
        for a in range(3):
            outside |= key[a] < 0 or key[a] >= shape[a]
        if outside and enter(key, step, t_max, t_delta, shape, last, resolution) == 0:
            continue
        met, entered = walk(bricks, key, step, t_max, t_delta, last, stops)
        if met == CLASS_FREE:
            continue
        squared = 0.0
        for a in range(3):
            centre = np.float32((np.float64(key[a] + key0[a]) + 0.5) * resolution)
            offset = centre - np.float32(origins[n, a])
            squared += np.float64(offset * offset)
        if entered > 0.0 and squared > max_range * max_range:
            continue
        outcome[n], distance[n] = met, entered
        voxels[n, 0], voxels[n, 1], voxels[n, 2] = key[0], key[1], key[2]
