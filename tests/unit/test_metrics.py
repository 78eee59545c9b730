"""Figures with known answers, and the laws that all of them obey."""

import math

import numpy as np
import pytest

from services.evaluator.metrics import (
    above_ground,
    chamfer,
    f_score,
    missing,
    nearest_voxel,
    precision,
    recall,
    score,
)
from services.evaluator.samples import place, sample
from services.evaluator.surface import Surface
from services.evaluator.visibility import Visibility
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

RADIUS_M = 0.2
CENTRE_M = np.array([0, 0, RADIUS_M])
VOXEL_M = 0.01


@pytest.fixture(scope="module")
def sphere():
    mesh = load_mesh("sphere", height_m=2 * RADIUS_M)
    surface = Surface(mesh.vertices_m, mesh.faces)
    return surface, place(sample(surface, 5000, seed=0), surface)


def shell(radius_m=RADIUS_M):
    """Centres of the voxels that a sphere's surface passes."""
    edge = np.arange(-0.3, 0.3, VOXEL_M) + VOXEL_M / 2
    centres = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), axis=-1).reshape(-1, 3)
    near = np.abs(np.linalg.norm(centres, axis=1) - radius_m) < VOXEL_M * math.sqrt(3) / 2
    return centres[near] + CENTRE_M


def figures(sphere, centres, tolerance_m):
    surface, placed = sphere
    everything = np.ones(len(placed.points_m), np.bool_)
    nearest = nearest_voxel(placed.points_m, centres)
    ghosts = surface.distance(centres)
    return score(nearest, ghosts, placed.weights, everything, everything, tolerance_m)


def test_the_shell_of_a_sphere_covers_it_and_holds_nothing_else(sphere):
    result = figures(sphere, shell(), VOXEL_M)
    assert result.coverage == result.precision == result.f_score == 1
    assert result.ghost_rate == 0


def test_half_a_shell_covers_half(sphere):
    half = shell()
    half = half[half[:, 0] > 0]
    result = figures(sphere, half, VOXEL_M)
    # By Archimedes a zone's area grows with its height: the rim adds up to tolerance / 2 r.
    assert 0.5 <= result.coverage <= 0.5 + VOXEL_M / (2 * RADIUS_M)
    assert result.precision == 1


@pytest.mark.parametrize("factor", [1, 2])
def test_a_shell_displaced_beyond_the_tolerance_is_all_ghosts(sphere, factor):
    result = figures(sphere, shell(RADIUS_M - 4 * VOXEL_M), factor * VOXEL_M)
    assert result.precision == result.coverage == result.f_score == 0
    assert result.ghost_rate == 1


def test_the_ghost_rate_is_the_share_of_false_voxels(sphere):
    true = shell()
    ghosts = np.random.default_rng(0).uniform(1, 2, size=(len(true) // 3, 3))
    result = figures(sphere, np.concatenate([true, ghosts]), VOXEL_M)
    assert result.ghost_rate == pytest.approx(len(ghosts) / (len(true) + len(ghosts)))
    assert result.coverage == 1


def test_distances_of_a_displaced_shell_are_its_displacement(sphere):
    surface, placed = sphere
    rng = np.random.default_rng(1)
    out = rng.normal(size=(20_000, 3))
    points = CENTRE_M + out / np.linalg.norm(out, axis=1, keepdims=True) * (RADIUS_M + 0.05)
    accuracy = float(surface.distance(points).mean())
    completeness = float(nearest_voxel(placed.points_m, points).mean())
    assert accuracy == pytest.approx(0.05, abs=3e-4)
    assert chamfer(accuracy, completeness) == pytest.approx(0.05, abs=5e-4)


def test_an_empty_map_covers_nothing_and_claims_nothing_false(sphere):
    result = figures(sphere, np.empty((0, 3)), VOXEL_M)
    assert (result.coverage, result.precision, result.f_score) == (0, 1, 0)


def test_nothing_is_missing_of_a_surface_that_nobody_can_see(sphere):
    _, placed = sphere
    nobody = np.zeros(len(placed.weights), np.bool_)
    assert recall(np.full(len(nobody), np.inf), placed.weights, VOXEL_M, nobody) == 1


def test_the_nearest_voxel_is_that_of_the_whole_table():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(200, 3)).astype(np.float32)
    centres = rng.normal(size=(300, 3))
    table = np.linalg.norm(points[:, None].astype(np.float64) - centres[None], axis=-1)
    assert np.allclose(nearest_voxel(points, centres), table.min(axis=1), atol=1e-12)


def test_coverage_and_precision_never_fall_when_the_tolerance_grows():
    rng = np.random.default_rng(3)
    distance, weights = rng.exponential(0.02, 500), rng.dirichlet(np.ones(500))
    tolerances = np.linspace(0, 0.1, 40)
    for values in (
        [recall(distance, weights, tau) for tau in tolerances],
        [precision(distance, tau) for tau in tolerances],
    ):
        assert np.all(np.diff(values) >= 0)
        assert values[0] == 0


def test_coverage_never_falls_when_voxels_are_added(sphere):
    _, placed = sphere
    voxels = np.random.default_rng(4).permutation(shell())
    parts = [len(voxels) * k // 8 for k in range(9)]
    values = [
        recall(nearest_voxel(placed.points_m, voxels[:n]), placed.weights, VOXEL_M) for n in parts
    ]
    assert np.all(np.diff(values) >= 0)
    assert values[-1] == 1


def test_the_f_score_lies_between_precision_and_recall():
    for p, r in np.random.default_rng(5).uniform(size=(200, 2)):
        assert min(p, r) - 1e-12 <= f_score(p, r) <= max(p, r) + 1e-12
        assert f_score(p, r) == f_score(r, p)
    assert f_score(0, 0) == 0


def test_chamfer_is_symmetric_and_zero_for_equal_sets():
    rng = np.random.default_rng(6)
    a, b = rng.normal(size=(2, 300, 3))

    def between(p, q):
        return chamfer(float(nearest_voxel(q, p).mean()), float(nearest_voxel(p, q).mean()))

    assert between(a, b) == pytest.approx(between(b, a), rel=1e-12)
    assert between(a, a) == 0


def test_the_reasons_partition_what_is_missing():
    rng = np.random.default_rng(7)
    for _ in range(20):
        weights = rng.dirichlet(np.ones(400)).astype(np.float32)
        in_view = rng.random(400) < 0.7
        cosine = np.where(in_view & (rng.random(400) < 0.7), rng.random(400), 0)
        nearest = rng.exponential(0.02, 400)
        reasons = missing(nearest, weights, Visibility(in_view, cosine.astype(np.float32)), 0.02)
        assert min(reasons.model_dump().values()) > 0
        total = sum(reasons.model_dump().values())
        assert total == pytest.approx(1 - recall(nearest, weights, 0.02), abs=1e-6)


def test_each_reason_is_given_to_whom_it_belongs():
    in_view = np.array([False, True, True, True])
    cosine = np.array([0, 0, math.cos(math.radians(80)), math.cos(math.radians(60))], np.float32)
    weights = np.array([0.1, 0.2, 0.3, 0.4], np.float32)
    reasons = missing(np.full(4, 1.0), weights, Visibility(in_view, cosine), 0.02)
    assert reasons.out_of_view == pytest.approx(0.1)
    assert reasons.self_occluded == pytest.approx(0.2)
    assert reasons.grazing == pytest.approx(0.3)
    assert reasons.not_yet_updated == pytest.approx(0.4)


def test_the_layers_that_touch_the_ground_are_left_out():
    heights = np.array([-0.005, 0.005, 0.0099, 0.0101, 0.015, 0.3])
    centres = np.stack([np.zeros(6), np.zeros(6), heights], axis=1)
    assert above_ground(centres, VOXEL_M)[:, 2].tolist() == [0.0101, 0.015, 0.3]
