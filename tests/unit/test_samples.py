"""Samples are spread by area, stay on the skin, and move with it."""

import numpy as np
import pytest

from services.evaluator.samples import place, sample
from services.evaluator.surface import Surface
from services.kernels.rigid import apply, rotation_exp
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

NUM = 3000


@pytest.fixture(scope="module", params=["sphere", "box", "torus", "bunny"])
def surface(request):
    mesh = load_mesh(request.param, height_m=0.4, subdivide=1)
    return Surface(mesh.vertices_m, mesh.faces)


def test_every_triangle_gets_its_share_of_samples_to_within_one(surface):
    area = np.linalg.norm(surface.face_vectors, axis=1)
    counts = np.bincount(sample(surface, NUM, seed=3).face, minlength=len(area))
    assert np.all(np.abs(counts - NUM * area / area.sum()) < 1 + 1e-6)


def test_samples_lie_on_the_surface(surface):
    placed = place(sample(surface, NUM, seed=1), surface)
    assert surface.distance(placed.points_m).max() < 1e-6


def test_barycentrics_are_shares(surface):
    barycentric = sample(surface, NUM, seed=2).barycentric
    assert np.allclose(barycentric.sum(axis=1), 1, atol=1e-6)
    assert barycentric.min() >= 0


def test_the_same_seed_gives_the_same_samples_and_another_does_not(surface):
    first, again, other = (sample(surface, NUM, seed) for seed in (7, 7, 8))
    assert np.array_equal(first.barycentric, again.barycentric)
    assert np.array_equal(first.face, again.face)
    assert not np.array_equal(first.barycentric, other.barycentric)


def test_samples_move_rigidly_with_a_rigid_body(surface):
    rng = np.random.default_rng(5)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_exp(rng.normal(size=3)), rng.normal(size=3)
    samples = sample(surface, NUM, seed=1)
    before = place(samples, surface)
    after = place(samples, Surface(apply(T, surface.vertices_m), surface.faces))
    assert np.allclose(after.points_m, apply(T, before.points_m), atol=1e-5)
    # Slivers of a float32 mesh have normals that are good to 1e-3 only.
    assert np.allclose(after.normals, before.normals @ T[:3, :3].T, atol=2e-3)
    assert np.allclose(after.weights, 1 / NUM, rtol=2e-3)


def test_what_a_deformation_stretches_counts_for_more():
    mesh = load_mesh("box", height_m=0.4)
    rest = Surface(mesh.vertices_m, mesh.faces)
    tall = Surface(mesh.vertices_m * np.array([1, 1, 3], np.float32), mesh.faces)
    samples = sample(rest, NUM, seed=0)
    placed = place(samples, tall)
    lying = np.abs(placed.normals[:, 2]) > 0.5
    # Two of a cube's six sides keep their area, four grow threefold.
    assert placed.weights[lying].sum() == pytest.approx(2 / 14, abs=2e-3)
    assert placed.weights.sum() == pytest.approx(1, abs=1e-5)


def test_triangles_without_area_get_no_sample_and_a_surface_without_area_is_refused():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    samples = sample(Surface(corners, [[0, 1, 1], [0, 1, 2], [2, 2, 2]]), 50, seed=0)
    assert np.all(samples.face == 1)
    with pytest.raises(ValueError, match="cannot draw 50 samples"):
        sample(Surface(corners, [[0, 1, 1]]), 50, seed=0)
