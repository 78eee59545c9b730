"""One instant, from voxels and truth to all figures."""

import math

import numpy as np
import pytest

from schemas.camera import Intrinsics
from services.evaluator.assessment import HEADLINE, assess
from services.evaluator.truth import Truth
from services.evaluator.views import View
from services.kernels.rigid import look_at
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

VOXEL_M = 0.01
OPTICS = Intrinsics.from_vertical_fov(640, 480, math.radians(45))


@pytest.fixture(scope="module")
def mesh():
    return load_mesh("bunny", height_m=0.4, subdivide=1)


@pytest.fixture(scope="module")
def truth(mesh):
    return Truth(mesh.vertices_m, mesh.faces, None, radius_m=1.1, num_samples=4000)


def ring(num, elevation_deg=20.0, radius_m=1.1):
    elevation = math.radians(elevation_deg)
    away, up = radius_m * math.cos(elevation), 0.2 + radius_m * math.sin(elevation)
    eyes = [(away * math.cos(a), away * math.sin(a), up) for a in 2 * np.pi * np.arange(num) / num]
    return [View(look_at(eye, (0, 0, 0.2)), OPTICS, 0.1, 3.0) for eye in eyes]


def voxels_of(points_m):
    """Centres of the voxels that the points fall in."""
    return (np.unique(np.floor(points_m / VOXEL_M), axis=0) + 0.5) * VOXEL_M


def test_the_voxels_of_the_surface_score_full_marks(truth):
    instant = truth.at(0.0)
    centres = voxels_of(instant.placed.points_m)
    result = assess(centres, VOXEL_M, instant, truth.observable, ring(6))
    wide = result.scores[HEADLINE]
    assert wide.tolerance_m == 2 * VOXEL_M
    assert wide.precision == 1
    assert wide.coverage_observable > 0.99
    # The soles lie in the ground's layers, which are not scored.
    assert 0.95 < wide.coverage < wide.coverage_observable
    assert 0 < result.accuracy_m < VOXEL_M
    assert 0 < result.completeness_m < VOXEL_M
    assert result.chamfer_m == pytest.approx((result.accuracy_m + result.completeness_m) / 2)


def test_the_ground_counts_for_nothing(truth):
    instant = truth.at(0.0)
    centres = voxels_of(instant.placed.points_m)
    x, y = np.meshgrid(np.arange(-0.6, 0.6, VOXEL_M), np.arange(-0.6, 0.6, VOXEL_M))
    ground = voxels_of(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + 1e-4)
    with_ground = np.concatenate([centres, ground, ground - [0, 0, VOXEL_M]])
    plain = assess(centres, VOXEL_M, instant, truth.observable, ring(6))
    assert assess(with_ground, VOXEL_M, instant, truth.observable, ring(6)) == plain


def test_an_empty_map_has_no_distances_and_misses_what_cameras_cannot_see(truth):
    instant = truth.at(0.0)
    result = assess(np.empty((0, 3)), VOXEL_M, instant, truth.observable, ring(6))
    assert result.accuracy_m is result.completeness_m is result.chamfer_m is None
    assert result.num_voxels == 0
    reasons = result.missing.model_dump()
    assert sum(reasons.values()) == pytest.approx(1, abs=1e-6)
    # Six cameras hold the whole bunny in view and see most of it; its belly they cannot.
    assert reasons["out_of_view"] == 0
    assert 0.02 < reasons["self_occluded"] < 0.2
    assert reasons["not_yet_updated"] > 0.6


def test_what_is_visible_is_observable_but_for_the_lattice(truth):
    instant = truth.at(0.0)
    centres = voxels_of(instant.placed.points_m[truth.observable])
    result = assess(centres, VOXEL_M, instant, truth.observable, ring(12))
    assert result.scores[HEADLINE].coverage_observable > 0.99
    assert result.scores[HEADLINE].coverage_visible > 0.99


def test_a_map_of_the_rest_shape_fails_when_the_body_has_deformed(mesh):
    def deform(t_s):
        return mesh.vertices_m * np.float32(1 + t_s)

    truth = Truth(mesh.vertices_m, mesh.faces, deform, radius_m=1.1, num_samples=4000)
    centres = voxels_of(truth.at(0.0).placed.points_m)
    rest, grown = (
        assess(centres, VOXEL_M, truth.at(t), truth.observable, ring(6)).scores[HEADLINE]
        for t in (0.0, 0.5)
    )
    assert rest.f_score > 0.97
    assert grown.f_score < 0.5


def test_samples_ride_on_the_deforming_skin(mesh):
    def deform(t_s):
        return mesh.vertices_m * np.float32(1 + t_s)

    truth = Truth(mesh.vertices_m, mesh.faces, deform, radius_m=1.1, num_samples=500)
    rest, grown = truth.at(0.0).placed, truth.at(0.25).placed
    assert np.allclose(grown.points_m, 1.25 * rest.points_m, atol=1e-6)
    assert np.allclose(grown.normals, rest.normals, atol=1e-3)


def test_a_rigid_body_keeps_its_tree(truth):
    assert truth.at(0.0).surface is truth.at(7.0).surface
