"""The faces of voxels are those between them and empty space."""

import numpy as np
import pytest

from services.kernels import cubes

pytestmark = pytest.mark.unit

SIDES = [tuple(sign * row) for row in np.eye(3, dtype=int) for sign in (-1, 1)]


def marked(voxels):
    cells = np.zeros(voxels.max(axis=0) + 3, np.uint8)
    cubes.mark(voxels, cells)
    return cells


def listed(voxels):
    cells = marked(voxels)
    num = cubes.count_faces(voxels, cells)
    corners = np.full((num, 4, 3), -9, np.int32)
    voxel, crowding = np.full(num, -9, np.int32), np.full((num, 4), 9, np.uint8)
    cubes.faces(voxels, cells, corners, voxel, crowding)
    return corners, voxel, crowding


@pytest.fixture
def voxels():
    return np.argwhere(np.random.default_rng(3).random((6, 5, 7)) < 0.3)


def test_faces_are_where_a_voxel_meets_an_empty_one(voxels):
    held = {tuple(v) for v in voxels.tolist()}
    corners, voxel, crowding = listed(voxels)
    expected = {(v, side) for v in held for side in SIDES if tuple(np.add(v, side)) not in held}
    found = set()
    for n, square in enumerate(corners):
        # Twice the way from the voxel's centre to the face's is the face's outward normal.
        outward = tuple((square.sum(axis=0) // 2 - 2 * voxels[voxel[n]] - 1).tolist())
        found.add((tuple(voxels[voxel[n]].tolist()), outward))
        normal = np.cross(square[1] - square[0], square[3] - square[0])
        assert tuple(normal.tolist()) == outward  # Counter-clockwise from outside, and of area 1.
        for corner, crowd in zip(square, crowding[n], strict=True):
            assert crowd == crowd_at(held, voxels[voxel[n]], np.array(outward), corner)
    assert found == expected
    assert len(corners) == len(expected)


def crowd_at(held, voxel, outward, corner):
    """The rule of the article, on sets: two sides shut a corner in, else each counts once."""
    before = voxel + outward
    axes = np.flatnonzero(outward == 0)
    steps = np.zeros((2, 3), int)
    for row, axis in zip(steps, axes, strict=True):
        row[axis] = 1 if corner[axis] > voxel[axis] else -1
    there = [tuple((before + way).tolist()) in held for way in (*steps, steps.sum(axis=0))]
    return 3 if there[0] and there[1] else sum(there)


def test_scatter_is_the_weighted_covariance_of_the_neighbourhood(voxels):
    reach, matrices = 2, np.empty((len(voxels), 3, 3))
    cubes.scatter(voxels, marked(voxels), reach, matrices)
    for voxel, matrix in zip(voxels, matrices, strict=True):
        away = voxels - voxel
        distance2 = (away**2).sum(axis=1)
        near = distance2 <= reach**2
        weight = 1 - distance2[near] / (reach**2 + 1)
        mean = weight @ away[near] / weight.sum()
        off = away[near] - mean
        np.testing.assert_allclose(matrix, (off * weight[:, None]).T @ off, atol=1e-9)


def test_the_direction_of_least_scatter_is_a_planes_normal():
    i, j = np.indices((9, 9)).reshape(2, -1)
    slope = np.stack([i, j, i], axis=1)  # z = x
    matrices = np.empty((len(slope), 3, 3))
    cubes.scatter(slope, marked(slope), 3, matrices)
    normals = np.linalg.eigh(matrices)[1][:, :, 0]
    np.testing.assert_allclose(np.abs(normals @ (1, 0, -1)) / np.sqrt(2), 1, atol=1e-9)
