"""Rays asked of a map end where OctoMap's `castRay` ends them."""

import itertools

import numpy as np
import pytest

from services.kernels.bricks import UNKNOWN
from services.mapper.answers import RayHits
from services.mapper.errors import BadPoints
from services.mapper.voxel_map import VoxelMap
from tests.octomap_reference import OCCUPIED, inserted

pytestmark = pytest.mark.unit

LOW, HIGH = np.array((-0.48, -0.48, -0.24)), np.array((0.48, 0.48, 0.24))
FREE, NO_RAY = 1, 255


def float32(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32).astype(np.float64)


def scanned(resolution: float, seed: int, num_points: int):
    """A map, OctoMap's tree of the same random scans, and those scans' rays."""
    rng = np.random.default_rng(seed)
    scans = []
    for _ in range(4):
        points = rng.uniform(LOW, HIGH, (num_points, 3)) * 0.95
        centres = (np.floor(points / resolution) + 0.5) * resolution
        scans.append((float32(centres), float32(rng.uniform(LOW, HIGH))))
    ours = VoxelMap(resolution, LOW, HIGH)
    for points, origin in scans:
        ours.fuse_points(points, origin)
    origins = np.concatenate([np.tile(origin, (len(points), 1)) for points, origin in scans])
    ways = np.concatenate([points - origin for points, origin in scans])
    return ours, inserted(resolution, scans), (origins, float32(ways))


def random_rays(seed: int, count: int, spread: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    origins, directions = rng.uniform(LOW, HIGH, (count, 3)) * spread, rng.normal(size=(count, 3))
    directions[: count // 4] *= rng.integers(0, 2, (count // 4, 3))  # along axes and planes.
    directions[~directions.any(axis=1)] = (0, 0, 1)
    return float32(origins), float32(directions)


@pytest.fixture(scope="module")
def sparse() -> VoxelMap:
    return scanned(0.02, seed=0, num_points=40)[0]


@pytest.mark.parametrize("unknown_stops", [False, True])
@pytest.mark.parametrize("max_range", [np.inf, 0.3])
@pytest.mark.parametrize(
    ("resolution", "num_points", "seed"),
    [(0.02, 40, 1), (0.02, 1000, 2), (0.01, 150, 3), (0.005, 100, 4)],
)
def test_every_ray_ends_in_octomaps_voxel(
    resolution: float, num_points: int, seed: int, max_range: float, unknown_stops: bool
) -> None:
    ours, tree, seen = scanned(resolution, seed, num_points)
    random = random_rays(seed + 100, 2000)
    origins, directions = (np.concatenate(both) for both in zip(seen, random, strict=True))
    hits = ours.cast_rays(origins, directions, max_range, unknown_stops)
    # OctoMap's rays do not end at the box: beyond it there is nothing to hit.
    longest = 2.5 if np.isinf(max_range) else max_range
    end = np.zeros(3)
    for n, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        hit = tree.castRay(origin, direction, end, not unknown_stops, longest)
        assert hit == (hits.outcome[n] == OCCUPIED), (origin, direction)
        if hit:
            np.testing.assert_allclose(hits.points_m[n], end, atol=1e-5)
    assert (hits.outcome == OCCUPIED).sum() > 10
    assert (hits.outcome != OCCUPIED).sum() > 50


def twin(voxel_map: VoxelMap, origin: np.ndarray, direction: np.ndarray, stops: bool):
    """Sort the crossings of all voxel borders; look at the voxel in the middle of each piece."""
    box, unit = voxel_map.box, direction / np.linalg.norm(direction)
    edges = [box.origin_m[a] + np.arange(box.shape[a] + 1) * box.resolution_m for a in range(3)]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.concatenate([(edges[a] - origin[a]) / unit[a] for a in range(3)])
    t = np.concatenate([[0.0], np.sort(t[np.isfinite(t) & (t > 0)])])
    middles = origin + (t[:-1, None] + t[1:, None]) / 2 * unit
    keys = box.keys(middles)
    inside = ((keys >= 0) & (keys < box.shape)).all(axis=1)
    classes = voxel_map.classify(middles)
    ends = inside & ((classes == OCCUPIED) | (stops & (classes == 0)))
    if not ends.any():
        return FREE, np.inf
    first = int(np.argmax(ends))
    return classes[first], t[first]


@pytest.mark.parametrize("stops", [False, True])
def test_the_kernel_ends_where_its_twin_does_from_inside_and_outside(
    sparse: VoxelMap, stops: bool
) -> None:
    origins, directions = random_rays(5, 800, spread=2.0)
    hits = sparse.cast_rays(origins, directions, unknown_stops=stops)
    expected = [twin(sparse, o, d, stops) for o, d in zip(origins, directions, strict=True)]
    outcome, distance_m = (np.array(part) for part in zip(*expected, strict=True))
    # Single precision moves a ray by 1e-7 of its length: a few pass the other side of an edge.
    same = (hits.outcome == outcome) & np.isclose(hits.distance_m, distance_m, atol=1e-5)
    assert same.mean() > 0.995
    assert len(set(outcome)) == (3 if stops else 2)


def test_a_hit_lies_on_the_ray_in_an_occupied_voxel(sparse: VoxelMap) -> None:
    origins, directions = random_rays(6, 2000, spread=2.0)
    hits = sparse.cast_rays(origins, directions)
    hit = hits.outcome == OCCUPIED
    assert (sparse.classify(hits.points_m[hit]) == OCCUPIED).all()
    unit = directions[hit] / np.linalg.norm(directions[hit], axis=1, keepdims=True)
    entered = origins[hit] + unit * hits.distance_m[hit, None]
    half = sparse.box.resolution_m / 2
    starts_in = hits.distance_m[hit] == 0
    assert (np.abs(entered - hits.points_m[hit])[~starts_in].max(axis=1) < half + 1e-5).all()
    assert np.isnan(hits.points_m[~hit]).all()
    assert np.isinf(hits.distance_m[~hit]).all()


def test_the_length_of_a_direction_says_nothing(sparse: VoxelMap) -> None:
    origins, directions = random_rays(7, 1000)
    expected = sparse.cast_rays(origins, directions)
    for factor in (2.0**-100, 0.25, 2.0, 2.0**100):
        scaled = sparse.cast_rays(origins, directions * factor)
        for one, other in zip(scaled, expected, strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_free_line_of_sight_is_free_from_both_ends(sparse: VoxelMap) -> None:
    origins, _ = random_rays(8, 1000)
    ends, _ = random_rays(9, 1000)
    length_m = np.linalg.norm(ends - origins, axis=1)

    def blocked(hits: RayHits) -> np.ndarray:
        return hits.distance_m < length_m - 1e-5

    there = sparse.cast_rays(origins, ends - origins)
    back = sparse.cast_rays(ends, origins - ends)
    assert (blocked(there) == blocked(back)).mean() > 0.995
    assert 50 < blocked(there).sum() < 950


def test_rays_along_every_diagonal_hit_what_they_point_at() -> None:
    ours = VoxelMap(0.02, LOW, HIGH)
    target = ours.box.centres_m(np.array([[24, 24, 12]]))[0]
    ours.fuse_points([target], (0.4, 0.4, 0.2))
    for way in itertools.product((-1, 0, 1), repeat=3):
        if any(way):
            hits = ours.cast_rays([target - 5.0 * np.array(way)], [way])
            assert hits.outcome.tolist() == [OCCUPIED]
            np.testing.assert_allclose(hits.points_m[0], target)


def test_unknown_space_stops_a_ray_only_if_asked_to() -> None:
    ours = VoxelMap(0.02, LOW, HIGH)
    ours.fuse_points([(0.3, 0.01, 0.01)], (0.1, 0.01, 0.01))
    origin, ahead, back = (0.11, 0.01, 0.01), (1, 0, 0), (-1, 0, 0)
    assert ours.cast_rays([origin, origin], [ahead, back]).outcome.tolist() == [OCCUPIED, FREE]
    stopped = ours.cast_rays([origin, origin], [ahead, back], unknown_stops=True)
    assert stopped.outcome.tolist() == [OCCUPIED, 0]
    assert stopped.points_m[1, 0] == pytest.approx(0.09)
    log_odds = ours.known_bricks()[1]
    assert (log_odds == UNKNOWN).any()


def test_what_is_no_ray_is_said_to_be_none_and_counted(sparse: VoxelMap) -> None:
    good = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    bad = [
        ((0, 0, 0), (0, 0, 0)),
        ((0, 0, 0), (np.nan, 0, 1)),
        ((0, 0, 0), (np.inf, 0, 0)),
        ((np.nan, 0, 0), (1, 0, 0)),
        ((1e30, 0, 0), (1, 0, 0)),
    ]
    origins, directions = zip(good, *bad, good, strict=True)
    hits = sparse.cast_rays(origins, directions)
    assert hits.num_invalid == len(bad)
    assert (hits.outcome[1:-1] == NO_RAY).all()
    assert np.isnan(hits.distance_m[1:-1]).all()
    assert hits.outcome[0] == hits.outcome[-1] != NO_RAY


def test_no_rays_have_no_answers(sparse: VoxelMap) -> None:
    assert [len(part) for part in sparse.cast_rays(np.empty((0, 3)), np.empty((0, 3)))] == [0, 0, 0]


@pytest.mark.parametrize(
    ("origins", "directions", "max_range"),
    [
        (np.zeros((2, 3)), np.ones((1, 3)), 1.0),
        (np.zeros(3), np.ones(3), 1.0),
        (np.zeros((1, 3)), np.ones((1, 3)), 0.0),
        (np.zeros((1, 3)), np.ones((1, 3)), np.nan),
        ([["a", 0, 0]], np.ones((1, 3)), 1.0),
        ([[0, 0, 0], [0, 0]], np.ones((2, 3)), 1.0),
    ],
)
def test_what_are_no_rays_at_all_is_refused(
    sparse: VoxelMap, origins, directions, max_range
) -> None:
    with pytest.raises(BadPoints):
        sparse.cast_rays(origins, directions, max_range)
