"""Distances to obstacles, and answers about parts of the box, are those of looking everywhere."""

import subprocess
import sys

import numpy as np
import pytest

from services.mapper import questions
from services.mapper.errors import BadBox, BadPoints, MissingScipy, TooMuchAsked
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

LOW, HIGH = (-0.48, -0.32, -0.16), (0.48, 0.32, 0.32)
BOUNDS = ((-0.21, -0.1, 0.05), (0.13, 0.2, 0.15))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture
def voxels(rng: np.random.Generator) -> VoxelMap:
    """Rays from the middle to 60 random points: all three classes, also within bricks."""
    made = VoxelMap(0.04, LOW, HIGH)
    made.fuse_points(rng.uniform(LOW, HIGH, (60, 3)), (0.0, 0.0, 0.1))
    return made


def centres_of(voxel_map: VoxelMap, is_obstacle: np.ndarray) -> np.ndarray:
    return voxel_map.box.centres_m(np.argwhere(is_obstacle))


def obstacles(voxel_map: VoxelMap, unknown_is: str) -> np.ndarray:
    log_odds = voxel_map.log_odds_dense()
    unknown = np.isnan(log_odds)
    return (log_odds >= 0) | (unknown & (unknown_is == "occupied"))


def brute_force(points: np.ndarray, centres: np.ndarray, reach_m: float) -> np.ndarray:
    apart = np.linalg.norm(points[:, None] - centres[None], axis=2)
    return np.minimum(apart.min(axis=1, initial=np.inf), reach_m)


@pytest.mark.parametrize("unknown_is", ["free", "occupied"])
@pytest.mark.parametrize("reach", [np.inf, 0.11])
def test_a_point_is_as_far_as_the_nearest_of_all_obstacles(
    rng: np.random.Generator, voxels: VoxelMap, unknown_is, reach: float
) -> None:
    points = rng.uniform(LOW, HIGH, (300, 3)) * 1.6  # outside of the box, too.
    expected = brute_force(points, centres_of(voxels, obstacles(voxels, unknown_is)), reach)
    np.testing.assert_allclose(voxels.distance(points, reach, unknown_is), expected)


@pytest.mark.parametrize("unknown_is", ["free", "occupied"])
@pytest.mark.parametrize(("bounds", "reach"), [(None, np.inf), (BOUNDS, 0.3), (BOUNDS, np.inf)])
def test_a_field_holds_the_distance_of_every_centre_also_to_obstacles_beyond_its_bounds(
    voxels: VoxelMap, unknown_is, bounds, reach: float
) -> None:
    field, origin_m = voxels.distance_field(bounds, reach, unknown_is)
    centres = origin_m + np.argwhere(np.ones(field.shape)) * voxels.box.resolution_m
    expected = brute_force(centres, centres_of(voxels, obstacles(voxels, unknown_is)), reach)
    np.testing.assert_allclose(field.ravel(), expected, atol=1e-6)
    np.testing.assert_allclose(voxels.distance(centres, reach, unknown_is), expected, atol=1e-9)


@pytest.mark.parametrize("unknown_is", ["free", "occupied"])
def test_a_point_hardly_within_reach_of_the_box_is_as_far_as_the_reach(unknown_is) -> None:
    empty = VoxelMap(0.1, (-0.4, -0.4, -0.4), (0.4, 0.4, 0.4))
    for x_m in (1e-9 - 0.9, 0.9 - 1e-9):
        assert empty.distance([(x_m, 0.0, 0.0)], 0.5, unknown_is) == 0.5


def test_bounds_are_the_voxels_they_touch(voxels: VoxelMap) -> None:
    field, origin_m = voxels.distance_field(((0.0, 0.0, 0.0), (0.08, 0.081, 0.0001)), 0.1)
    assert field.shape == (2, 3, 1)
    np.testing.assert_allclose(origin_m, 0.02)
    everything, corner_m = voxels.distance_field(((-9, -9, -9), (9, 9, 9)), 0.1)
    assert everything.shape == voxels.box.shape
    np.testing.assert_allclose(corner_m, voxels.box.origin_m + 0.02)


def test_without_an_obstacle_everything_is_out_of_reach() -> None:
    empty = VoxelMap(0.04, LOW, HIGH)
    assert empty.distance([(0, 0, 0)]).tolist() == [np.inf]
    assert (empty.distance_field(reach_m=2.0)[0] == 2.0).all()
    assert empty.distance([(0.02, 0.02, 0.02)], unknown_is="occupied").tolist() == [0.0]


def test_a_point_that_is_not_finite_has_no_distance(voxels: VoxelMap) -> None:
    points = [(np.nan, 0, 0), (0, 0, 0), (0, np.inf, 0)]
    assert np.isnan(voxels.distance(points)).tolist() == [True, False, True]
    assert len(voxels.distance(np.empty((0, 3)))) == 0


@pytest.mark.parametrize("bounds", [None, BOUNDS, ((-9, 0.01, 0.01), (9, 0.02, 0.02))])
def test_unknown_voxels_and_entropy_of_a_part_are_those_of_the_dense_map(
    voxels: VoxelMap, bounds
) -> None:
    low, high = bounds or (voxels.box.origin_m, voxels.box.origin_m + 9)
    keys = np.argwhere(np.ones(voxels.box.shape))
    edge = np.array(voxels.box.first_key) + keys
    unit = voxels.box.resolution_m
    touched = (edge * unit < np.array(high) - 1e-9) & ((edge + 1) * unit > np.array(low) + 1e-9)
    touched = touched.all(axis=1)
    log_odds = voxels.log_odds_dense().reshape(-1).astype(float)
    unknown = touched & np.isnan(log_odds)
    assert 0 < unknown.sum() < touched.sum()
    np.testing.assert_allclose(voxels.unknown(bounds), voxels.box.centres_m(keys[unknown]))
    p = 1 / (1 + np.exp(-log_odds[touched & ~unknown]))
    bits = (-p * np.log2(p) - (1 - p) * np.log2(1 - p)).sum() + unknown.sum()
    assert voxels.entropy_bits(bounds) == pytest.approx(bits, rel=1e-3)


@pytest.mark.parametrize(
    ("bounds", "says"),
    [
        (((0, 0, 0), (0.1, 0.1, 0)), "volume"),
        (((0, 0, 0), (0.1, -0.1, 0.1)), "volume"),
        (((0, 0, 0), (0.1, 0.1, np.nan)), "finite"),
        (((0, 0), (0.1, 0.1)), "x, y, z"),
        (((5, 5, 5), (6, 6, 6)), "lie outside the box"),
    ],
)
def test_bounds_that_are_none_are_refused(voxels: VoxelMap, bounds, says: str) -> None:
    for ask in (voxels.distance_field, voxels.unknown, voxels.entropy_bits):
        with pytest.raises(BadBox, match=says):
            ask(bounds)


def test_an_answer_that_is_too_large_is_refused_with_its_number(voxels, monkeypatch) -> None:
    monkeypatch.setattr(questions, "MAX_VOXELS", 1000)
    for ask in (voxels.distance_field, voxels.unknown):
        with pytest.raises(TooMuchAsked, match=f"{voxels.box.num_voxels} voxels .* at most 1000"):
            ask()
    with pytest.raises(TooMuchAsked, match="at most 1000"):
        voxels.distance([(0, 0, 0)], unknown_is="occupied")
    assert voxels.distance([(0, 0, 0)]) < 1.0  # Occupied voxels are listed, not laid out.


@pytest.mark.parametrize(("reach", "unknown_is"), [(0.0, "free"), (np.nan, "free"), (1.0, "maybe")])
def test_a_wrong_reach_or_rule_is_refused(voxels: VoxelMap, reach, unknown_is) -> None:
    for ask in (
        lambda: voxels.distance([(0, 0, 0)], reach, unknown_is),
        lambda: voxels.distance_field(None, reach, unknown_is),
    ):
        with pytest.raises(BadPoints, match=r"reach|known: free, occupied"):
            ask()


def test_without_scipy_the_error_names_the_extra_and_the_mapper_works(voxels, monkeypatch) -> None:
    for name in ("scipy", "scipy.ndimage", "scipy.spatial"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingScipy, match=r"encircle\[queries\]"):
        voxels.distance([(0, 0, 0)])
    assert len(voxels.classify([(0, 0, 0)])) == 1


def test_scipy_is_not_loaded_with_the_mapper() -> None:
    code = "import sys, services.mapper.service; assert 'scipy.spatial' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
