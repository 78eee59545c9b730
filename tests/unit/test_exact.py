"""The exact integrator is OctoMap, voxel for voxel."""

import numpy as np
import pytest

from services.mapper.exact import ExactIntegrator
from services.mapper.voxel_map import VoxelMap
from tests.octomap_reference import classes_in, classes_of, inserted, log_odds_in

pytestmark = pytest.mark.unit

LOW, HIGH = np.array((-0.32, -0.32, -0.16)), np.array((0.32, 0.32, 0.16))
TOLERANCE = 1e-3


def float32(points: np.ndarray) -> np.ndarray:
    return points.astype(np.float32).astype(np.float64)


def clouds(rng: np.random.Generator, spread: float, count: int, num_points: int):
    """Random points in the box scaled by `spread`, seen from random origins in it."""
    return [
        (
            float32(rng.uniform(LOW * spread, HIGH * spread, (num_points, 3))),
            float32(rng.uniform(LOW * spread, HIGH * spread)),
        )
        for _ in range(count)
    ]


def assert_equal_maps(ours: VoxelMap, theirs: np.ndarray) -> None:
    np.testing.assert_array_equal(classes_in(ours), classes_of(theirs))
    known = ~np.isnan(theirs)
    np.testing.assert_allclose(ours.log_odds_dense()[known], theirs[known], atol=TOLERANCE)


@pytest.mark.parametrize("discretize", [True, False])
@pytest.mark.parametrize(
    ("resolution", "spread", "max_range", "seed"),
    [
        (0.01, 0.95, None, 0),
        (0.01, 2.0, None, 1),  # origins and ends in the box and out of it.
        (0.01, 2.0, 0.4, 2),
        (0.01, 0.95, 0.15, 3),
        (0.005, 0.95, None, 4),
        (0.04, 5.0, None, 5),
    ],
)
def test_every_voxel_has_octomaps_class_and_log_odds(
    resolution: float, spread: float, max_range: float | None, seed: int, discretize: bool
) -> None:
    scans = clouds(np.random.default_rng(seed), spread, count=4, num_points=400)
    ours = VoxelMap(resolution, LOW, HIGH)
    for points, origin in scans:
        ours.fuse_points(points, origin, max_range or np.inf, discretize)
    tree = inserted(resolution, scans, max_range or -1.0, discretize)
    assert_equal_maps(ours, log_odds_in(tree, ours.box))


def test_many_looks_at_few_voxels_saturate_as_octomaps_do() -> None:
    rng = np.random.default_rng(6)
    scans = clouds(rng, 0.9, count=3, num_points=30) * 8
    ours = VoxelMap(0.02, LOW, HIGH)
    for points, origin in scans:
        ours.fuse_points(points, origin)
    assert_equal_maps(ours, log_odds_in(inserted(0.02, scans), ours.box))


def test_rays_from_far_outside_are_clipped_to_the_box_and_not_dropped() -> None:
    ours = VoxelMap(0.01, LOW, HIGH)
    ours.fuse_points([(500.0, 0.003, 0.004)], (-500.0, 0.003, 0.004))
    free = ours.free().centres_m
    assert len(free) == ours.box.shape[0]
    np.testing.assert_allclose(free[:, 1:], [(0.005, 0.005)] * len(free))
    assert ours.counts().occupied == 0


def test_rays_that_miss_the_box_say_nothing() -> None:
    ours = VoxelMap(0.01, LOW, HIGH)
    ours.fuse_points([(3.0, 0.0, 3.0), (3.0, 3.0, 0.0), (-2.0, 0.0, 0.0)], (-3.0, 0.0, 0.0))
    assert ours.counts().unknown == ours.box.num_voxels


def test_points_that_are_not_finite_are_skipped_and_counted() -> None:
    rng = np.random.default_rng(8)
    points, origin = clouds(rng, 0.9, count=1, num_points=50)[0]
    bad = [(np.nan, 0, 0), (0, np.inf, 0), (0, 0, -np.inf), (1e300, 0, 0), (3e38, 0, 0)]
    ours, clean = VoxelMap(0.01, LOW, HIGH), VoxelMap(0.01, LOW, HIGH)
    assert ours.fuse_points(np.concatenate([bad, points, bad]), origin).num_skipped == 10
    assert clean.fuse_points(points, origin).num_skipped == 0
    np.testing.assert_array_equal(ours.log_odds_dense(), clean.log_odds_dense())


def test_points_beyond_the_maximum_range_free_their_ray_up_to_it() -> None:
    ours = VoxelMap(0.01, LOW, HIGH)
    ours.fuse_points([(30.0, 0.003, 0.004)], (0.001, 0.003, 0.004), max_range_m=0.1)
    assert ours.counts().occupied == 0
    assert ours.free().centres_m[:, 0].max() == pytest.approx(0.095)


def test_an_empty_cloud_changes_nothing() -> None:
    ours = VoxelMap(0.01, LOW, HIGH)
    ours.fuse_points(np.empty((0, 3)), (0, 0, 0))
    assert ours.counts().unknown == ours.box.num_voxels


def test_the_order_of_points_does_not_matter() -> None:
    rng = np.random.default_rng(9)
    points, origin = clouds(rng, 1.5, count=1, num_points=500)[0]
    one, other = VoxelMap(0.01, LOW, HIGH), VoxelMap(0.01, LOW, HIGH)
    one.fuse_points(points, origin)
    other.fuse_points(points[::-1], origin)
    np.testing.assert_array_equal(one.log_odds_dense(), other.log_odds_dense())


def test_many_threads_walk_to_the_same_map() -> None:
    one, many = VoxelMap(0.01, LOW, HIGH), VoxelMap(0.01, LOW, HIGH)
    for points, origin in clouds(np.random.default_rng(10), 1.5, count=3, num_points=3000):
        assert one.fuse_points(points, origin) == many.fuse_points(points, origin, threads=3)
        np.testing.assert_array_equal(one.log_odds_dense(), many.log_odds_dense())


def test_an_interrupted_cloud_leaves_nothing_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    points, origin = clouds(np.random.default_rng(11), 0.9, count=1, num_points=300)[0]
    ours, clean = VoxelMap(0.01, LOW, HIGH), VoxelMap(0.01, LOW, HIGH)
    with monkeypatch.context() as patch:
        patch.setattr(ExactIntegrator, "_walk", lambda *_: [][0])
        with pytest.raises(IndexError):
            ours.fuse_points(points[:100], origin)
    ours.fuse_points(points[100:], origin)
    clean.fuse_points(points[100:], origin)
    np.testing.assert_array_equal(ours.log_odds_dense(), clean.log_odds_dense())
