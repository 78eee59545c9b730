"""Where rays end: the voxels that points lie in, and the rays that are worth walking.

Arithmetic is OctoMap's (`coordToKey`, `insertPointCloud`, `computeDiscreteUpdate`): points are in
single precision, keys in double.
"""

import numpy as np
from numba import njit

OUTSIDE, BEYOND, SKIPPED = -1, -2, -3
"""Addresses of ends that lie in no voxel of the box, beyond the maximum range, nowhere."""
_FAR_VOXELS = 2.0e9  # keys are int32 there and back.


@njit(cache=True, error_model="numpy", nogil=True)
def columns(points, ends):  # type: ignore[no-untyped-def]
    """Write points (N, 3) as ends (3, N), so that SIMD reads neighbours."""
    x, y, z = ends[0], ends[1], ends[2]
    for n in range(points.shape[0]):
        x[n], y[n], z[n] = points[n, 0], points[n, 1], points[n, 2]


@njit(cache=True, error_model="numpy", nogil=True)
def round_ends(ends, origin, resolution, discretize, max_range, address):  # type: ignore[no-untyped-def]
    """Move ends (3, N) float32, m, to voxel centres in place if `discretize`; write who ends where.

    Args:
        origin: (3,) float32, max_range: m. address: (N,) int32, written: 0, BEYOND or SKIPPED.
    """
    inverse = 1.0 / resolution
    reach = np.float32(_FAR_VOXELS * resolution)
    ox, oy, oz = origin[0], origin[1], origin[2]
    ex, ey, ez = ends[0], ends[1], ends[2]
    for n in range(address.size):
        x, y, z = ex[n], ey[n], ez[n]
        # NaN fails every comparison.
        usable = (abs(x) < reach) & (abs(y) < reach) & (abs(z) < reach)
        if discretize:
            x = np.float32((np.floor(inverse * np.float64(x)) + 0.5) * resolution)
            y = np.float32((np.floor(inverse * np.float64(y)) + 0.5) * resolution)
            z = np.float32((np.floor(inverse * np.float64(z)) + 0.5) * resolution)
        dx, dy, dz = x - ox, y - oy, z - oz
        beyond = np.sqrt(np.float64(dx * dx + dy * dy + dz * dz)) > max_range
        ex[n], ey[n], ez[n] = x, y, z
        near = np.int32(BEYOND) if beyond else np.int32(0)
        address[n] = near if usable else np.int32(SKIPPED)


@njit(cache=True, error_model="numpy", nogil=True)
def address_ends(ends, key0, shape, resolution, address):  # type: ignore[no-untyped-def]
    """Write the address (brick * 512 + voxel) of every end, OUTSIDE for none, where it is not < 0.

    Args:
        ends: (3, N) float32, m. key0, shape: (3,) int64, key of the box's first voxel, its voxels.
    """
    inverse = 1.0 / resolution
    # OctoMap takes the key of the end it casts to, so a rounded centre counts.
    x0, y0, z0 = np.float64(key0[0]), np.float64(key0[1]), np.float64(key0[2])
    nx, ny, nz = np.float64(shape[0]), np.float64(shape[1]), np.float64(shape[2])
    by, bz = np.int32(shape[1] >> 3), np.int32(shape[2] >> 3)
    ex, ey, ez = ends[0], ends[1], ends[2]
    for n in range(address.size):
        i = np.floor(inverse * np.float64(ex[n])) - x0
        j = np.floor(inverse * np.float64(ey[n])) - y0
        k = np.floor(inverse * np.float64(ez[n])) - z0
        inside = (i >= 0) & (j >= 0) & (k >= 0) & (i < nx) & (j < ny) & (k < nz)
        a, b = np.int32(i if inside else 0.0), np.int32(j if inside else 0.0)
        c = np.int32(k if inside else 0.0)
        brick = ((a >> 3) * by + (b >> 3)) * bz + (c >> 3)
        voxel = (brick << 9) | ((a & 7) << 6) | ((b & 7) << 3) | (c & 7)
        place = voxel if inside else np.int32(OUTSIDE)
        address[n] = place if address[n] >= 0 else address[n]


@njit(cache=True, error_model="numpy", nogil=True)
def cut(ends, n, origin, max_range, out, kept):  # type: ignore[no-untyped-def]
    """Write the point of ray n at the maximum range, m, as OctoMap does in single precision."""
    dx, dy, dz = ends[0, n] - origin[0], ends[1, n] - origin[1], ends[2, n] - origin[2]
    norm = np.float32(np.sqrt(np.float64(dx * dx + dy * dy + dz * dz)))
    limit = np.float32(max_range)
    out[0, kept] = origin[0] + dx / norm * limit
    out[1, kept] = origin[1] + dy / norm * limit
    out[2, kept] = origin[2] + dz / norm * limit


@njit(cache=True, error_model="numpy", nogil=True)
def mark_ends(marks, ends, address, origin, max_range, discretize, out, kept):  # type: ignore[no-untyped-def]
    """Mark the voxels that points end in and list the rays to walk; write in place.

    Args:
        marks: (B * WORDS,) uint64, written. ends: (3, N) float32, m; address: (N,) int32, see
            `address_ends`. discretize: walk one ray per voxel.
        out: (3, M) float32, m, ends of the rays to walk, written from `kept` on.

    Returns:
        Rays listed, voxels newly marked, points skipped.
    """
    hits, skipped = 0, 0
    before = np.int32(SKIPPED)
    for n in range(address.size):
        place = address[n]
        # Neighbouring points mostly end in the same voxel.
        if discretize and place == before and place >= 0:
            continue
        if place == SKIPPED:
            skipped += 1
            continue
        if place == BEYOND:
            cut(ends, n, origin, max_range, out, kept)
            kept += 1
            continue
        if place >= 0 and place != before:
            before = place
            bit = np.uint64(1) << np.uint64(place & 63)
            is_new = marks[place >> 6] & bit == 0
            marks[place >> 6] |= bit
            hits += is_new
            if discretize and not is_new:
                continue
        out[0, kept], out[1, kept], out[2, kept] = ends[0, n], ends[1, n], ends[2, n]
        kept += 1
    return kept, hits, skipped
