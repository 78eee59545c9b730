"""What lies near a point among voxels on a lattice: moments of their centres, their mean color."""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def near_weight(dx, dy, dz, reach):  # type: ignore[no-untyped-def]
    """Return the weight of a centre so far away, voxels: a bell, zero beyond the reach."""
    squared = (dx * dx + dy * dy + dz * dz) / (reach * reach)
    return np.exp(-4.0 * squared) if squared < 1.0 else 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def near_moments(points, number, reach, count, mean, second):  # type: ignore[no-untyped-def]
    """Sum up the centres of voxels within reach of points; all lengths in voxels.

    Args:
        points: (N, 3); the centre of voxel (i, j, k) is i, j, k.
        number: (nx, ny, nz) int32, negative where there is no voxel.
        count: (N,) voxels within reach; written.
        mean: (N, 3) their weighted mean relative to the point, 0 if there is none; written.
        second: (N, 3, 3) their weighted covariance; written.
    """
    for n in range(points.shape[0]):
        weights = 0.0
        count[n], mean[n], second[n] = 0, 0.0, 0.0
        x, y, z = points[n]
        for i in range(max(0, int(x - reach)), min(number.shape[0], int(x + reach) + 1)):
            for j in range(max(0, int(y - reach)), min(number.shape[1], int(y + reach) + 1)):
                for k in range(max(0, int(z - reach)), min(number.shape[2], int(z + reach) + 1)):
                    weight = near_weight(i - x, j - y, k - z, reach)
                    if number[i, j, k] < 0 or weight == 0.0:
                        continue
                    off = (i - x, j - y, k - z)
                    weights += weight
                    count[n] += 1
                    for a in range(3):
                        mean[n, a] += weight * off[a]
                        for b in range(3):
                            second[n, a, b] += weight * off[a] * off[b]
        if count[n] == 0:
            continue
        mean[n] /= weights
        for a in range(3):
            for b in range(3):
                second[n, a, b] = second[n, a, b] / weights - mean[n, a] * mean[n, b]


@njit(cache=True, error_model="numpy", nogil=True)
def near_colors(points, number, reach, color, unset, out):  # type: ignore[no-untyped-def]
    """Write (N, 3) the mean color of voxels within reach of points, of those that have one.

    Args:
        points, number, reach: as in `near_moments`; `number` is the voxel's row in `color`.
        color: (M, 3) uint8; `unset` on all three channels is none. out: (N, 3) uint8; written.
    """
    total = np.empty(3)
    for n in range(points.shape[0]):
        weights = 0.0
        total[:] = 0.0
        x, y, z = points[n]
        for i in range(max(0, int(x - reach)), min(number.shape[0], int(x + reach) + 1)):
            for j in range(max(0, int(y - reach)), min(number.shape[1], int(y + reach) + 1)):
                for k in range(max(0, int(z - reach)), min(number.shape[2], int(z + reach) + 1)):
                    weight = near_weight(i - x, j - y, k - z, reach)
                    if number[i, j, k] < 0 or weight == 0.0:
                        continue
                    rgb = color[number[i, j, k]]
                    if rgb[0] != unset or rgb[1] != unset or rgb[2] != unset:
                        weights += weight
                        total += weight * rgb
        for c in range(3):
            out[n, c] = np.uint8(np.rint(total[c] / weights)) if weights > 0.0 else unset
