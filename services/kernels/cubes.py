"""The faces of occupied voxels that something can be seen of, and how they lie.

Voxels are marked in a grid with an empty border of one cell: voxel (i, j, k) is cell
(i + 1, j + 1, k + 1).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, error_model="numpy", nogil=True)
def mark(voxels: NDArray[np.int64], cells: NDArray[np.uint8]) -> None:
    """Set the cells of the (N, 3) voxels to 1."""
    for n in range(voxels.shape[0]):
        cells[voxels[n, 0] + 1, voxels[n, 1] + 1, voxels[n, 2] + 1] = 1


@njit(cache=True, error_model="numpy", nogil=True)
def count_faces(voxels: NDArray[np.int64], cells: NDArray[np.uint8]) -> int:
    """Count the faces of the (N, 3) voxels beyond which no voxel lies."""
    total = 0
    for n in range(voxels.shape[0]):
        i, j, k = voxels[n, 0] + 1, voxels[n, 1] + 1, voxels[n, 2] + 1
        total += 6 - (
            cells[i - 1, j, k] + cells[i + 1, j, k] + cells[i, j - 1, k]
            + cells[i, j + 1, k] + cells[i, j, k - 1] + cells[i, j, k + 1]
        )  # fmt: skip
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def faces(
    voxels: NDArray[np.int64],
    cells: NDArray[np.uint8],
    corners: NDArray[np.int32],
    voxel: NDArray[np.int32],
    crowding: NDArray[np.uint8],
) -> None:
    """List the faces beyond which no voxel lies.

    Args:
        voxels: (N, 3).
        cells: (X + 2, Y + 2, Z + 2) the voxels marked.
        corners: (F, 4, 3) out: lattice points, counter-clockwise seen from outside.
        voxel: (F,) out: row of the voxel that the face belongs to.
        crowding: (F, 4) out: how shut in a corner is by voxels before the face, 0 to 3 (Lysenko,
            Ambient occlusion for Minecraft-like worlds, 2013).
    """
    row = 0
    here, normal = np.empty(3, np.int64), np.empty(3, np.int64)
    for n in range(voxels.shape[0]):
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            for sign in (-1, 1):
                normal[:] = 0
                normal[axis] = sign
                for k in range(3):
                    here[k] = voxels[n, k] + 1 + normal[k]
                if cells[here[0], here[1], here[2]]:
                    continue
                voxel[row] = n
                for corner in range(4):
                    # (0, 0), (1, 0), (1, 1), (0, 1) on b and c; the other way round below.
                    one, two = (corner == 1) | (corner == 2), corner >= 2
                    on_b, on_c = (one, two) if sign > 0 else (two, one)
                    corners[row, corner, axis] = voxels[n, axis] + (sign > 0)
                    corners[row, corner, b] = voxels[n, b] + on_b
                    corners[row, corner, c] = voxels[n, c] + on_c
                    here[b] += 2 * on_b - 1
                    beside_b = cells[here[0], here[1], here[2]]
                    here[c] += 2 * on_c - 1
                    beyond = cells[here[0], here[1], here[2]]
                    here[b] -= 2 * on_b - 1
                    beside_c = cells[here[0], here[1], here[2]]
                    here[c] -= 2 * on_c - 1
                    both = beside_b & beside_c
                    crowding[row, corner] = 3 if both else beside_b + beside_c + beyond
                row += 1


@njit(cache=True, error_model="numpy", nogil=True)
def scatter(
    voxels: NDArray[np.int64],
    cells: NDArray[np.uint8],
    reach: int,
    matrices: NDArray[np.float64],
) -> None:
    """Fill `matrices` (N, 3, 3) with the scatter of the voxels around each voxel.

    The direction of least scatter is the normal of the surface that the voxels lie on. Those
    farther away than `reach` voxels do not count, near ones count more.
    """
    width, depth, height = cells.shape
    for n in range(voxels.shape[0]):
        matrix = matrices[n]
        matrix[:] = 0.0
        total, x, y, z = 0.0, 0.0, 0.0, 0.0
        for di in range(-reach, reach + 1):
            i = voxels[n, 0] + 1 + di
            if i < 0 or i >= width:
                continue
            for dj in range(-reach, reach + 1):
                j = voxels[n, 1] + 1 + dj
                if j < 0 or j >= depth:
                    continue
                for dk in range(-reach, reach + 1):
                    k = voxels[n, 2] + 1 + dk
                    distance2 = di * di + dj * dj + dk * dk
                    if k < 0 or k >= height or distance2 > reach * reach or not cells[i, j, k]:
                        continue
                    weight = 1.0 - distance2 / (reach * reach + 1.0)
                    total += weight
                    x += weight * di
                    y += weight * dj
                    z += weight * dk
                    matrix[0, 0] += weight * di * di
                    matrix[0, 1] += weight * di * dj
                    matrix[0, 2] += weight * di * dk
                    matrix[1, 1] += weight * dj * dj
                    matrix[1, 2] += weight * dj * dk
                    matrix[2, 2] += weight * dk * dk
        matrix[0, 0] -= x * x / total
        matrix[0, 1] -= x * y / total
        matrix[0, 2] -= x * z / total
        matrix[1, 1] -= y * y / total
        matrix[1, 2] -= y * z / total
        matrix[2, 2] -= z * z / total
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
