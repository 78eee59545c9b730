"""The surface knows distances and what it hides; without its extra it says what to install."""

import sys

import numpy as np
import pytest

from services.evaluator.distance_memo import DistanceMemo
from services.evaluator.open3d_loader import open3d
from services.evaluator.surface import Surface
from services.runtime.errors import MissingExtra
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

RADIUS_M = 0.2
CENTRE_M = np.array([0, 0, RADIUS_M])


@pytest.fixture(scope="module")
def sphere():
    mesh = load_mesh("sphere", height_m=2 * RADIUS_M)
    return Surface(mesh.vertices_m, mesh.faces)


def test_the_distance_to_a_sphere_is_that_of_the_radii_inside_and_outside(sphere):
    points = CENTRE_M + np.random.default_rng(0).normal(size=(500, 3)) * 0.3
    expected = np.abs(np.linalg.norm(points - CENTRE_M, axis=1) - RADIUS_M)
    # The mesh's edges are 15 mm long: its faces lie up to 0.2 mm under the sphere.
    assert np.allclose(sphere.distance(points), expected, atol=3e-4)


def test_normals_point_outward(sphere):
    middles = sphere.vertices_m[sphere.faces].mean(axis=1) - CENTRE_M
    assert np.einsum("fd,fd->f", sphere.face_vectors, middles).min() > 0


def test_the_far_side_is_occluded_and_the_near_side_is_not(sphere):
    poles = np.array([[RADIUS_M, 0, RADIUS_M], [-RADIUS_M, 0, RADIUS_M]], np.float32)
    eyes = np.array([[1, 0.01, 0.2], [1, 0.01, 0.2]], np.float32)
    assert sphere.occluded(poles, eyes).tolist() == [False, True]


def test_no_points_are_no_question(sphere):
    nothing = np.empty((0, 3), np.float32)
    assert sphere.distance(nothing).shape == (0,)
    assert sphere.occluded(nothing, nothing).shape == (0,)


def test_remembered_distances_are_those_of_the_surface(sphere):
    rng = np.random.default_rng(1)
    memo = DistanceMemo(sphere)
    points = np.rint(rng.normal(size=(400, 3)) * 50) * 0.005
    points[::40] *= 1e3  # Beyond what has a key.
    for _ in range(5):
        asked = rng.permutation(points)[: rng.integers(0, 400)]
        noise = rng.normal(size=asked.shape) * 1e-12
        assert np.allclose(memo.distance(asked + noise), sphere.distance(asked), rtol=1e-6)


def test_a_known_distance_is_not_asked_for_again(sphere):
    asked = []

    class Counting(Surface):
        def distance(self, points_m):
            asked.append(len(points_m))
            return super().distance(points_m)

    memo = DistanceMemo(Counting(sphere.vertices_m, sphere.faces))
    points = np.random.default_rng(2).normal(size=(100, 3))
    memo.distance(points[:60])
    memo.distance(points[40:])
    assert asked == [60, 40]


@pytest.mark.parametrize("missing", ["open3d", "libusb_package"])
def test_a_missing_extra_says_how_to_install_it(monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(MissingExtra, match=r"pip install 'encircle\[evaluator\]'"):
        open3d.__wrapped__()
