"""The map as its user sees it: laws of fusing, forgetting, asking, saving, refusing."""

import math

import numpy as np
import pytest

from services.mapper.errors import (
    BadBox,
    BadDecay,
    BadDepth,
    BadIntrinsics,
    BadMapFile,
    BadPoints,
    BadPose,
    BadSensorModel,
    MapTooLarge,
)
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.view import View
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

LOW, HIGH = (-0.32, -0.32, -0.16), (0.32, 0.32, 0.32)
RESOLUTION_M = 0.02
PINHOLE = (90.0, 90.0, 39.5, 29.5)
SHAPE = (60, 80)


def looking_down(height_m: float = 0.6) -> np.ndarray:
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = height_m
    return T


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture
def voxels() -> VoxelMap:
    return VoxelMap(RESOLUTION_M, LOW, HIGH)


def step_image() -> np.ndarray:
    """A floor at z = 0.01 m under a block at z = 0.21 m, seen from 0.6 m."""
    image = np.full(SHAPE, 590, np.uint16)
    image[20:40, 30:50] = 390
    return image


def dense_classes(voxel_map: VoxelMap) -> np.ndarray:
    log_odds = voxel_map.log_odds_dense()
    return np.where(np.isnan(log_odds), 0, np.where(log_odds >= 0, 2, 1))


def applied(changes: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    mirror = mirror.copy()
    mirror[tuple(changes[:, :3].T)] = changes[:, 3]
    return mirror


def test_a_new_map_knows_nothing(voxels: VoxelMap) -> None:
    assert voxels.counts() == (voxels.box.num_voxels, 0, 0)
    assert voxels.entropy_bits() == voxels.box.num_voxels
    assert len(voxels.changes()) == 0
    assert len(voxels.occupied().centres_m) == 0


def test_space_before_the_return_is_free_the_return_occupied_and_behind_it_unknown(
    voxels: VoxelMap,
) -> None:
    voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    ahead, surface, behind = (0.01, 0.01, 0.29), (0.01, 0.01, 0.21), (0.01, 0.01, 0.11)
    assert voxels.classify([ahead, surface, behind]).tolist() == [1, 2, 0]


def test_outside_the_box_everything_is_unknown(voxels: VoxelMap) -> None:
    voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    assert voxels.classify([(9.0, 0, 0), (math.nan, 0, 0), (math.inf, 0, 0)]).tolist() == [0, 0, 0]


def test_invalid_pixels_say_nothing_and_no_return_frees_up_to_the_maximum_range(
    voxels: VoxelMap,
) -> None:
    voxels.fuse_depth(np.zeros(SHAPE, np.uint16), PINHOLE, looking_down())
    assert voxels.counts().free == 0
    nothing = np.full(SHAPE, 65535, np.uint16)
    voxels.fuse_depth(nothing, PINHOLE, looking_down(), max_range_m=0.41)
    free_z = voxels.free().centres_m[:, 2]
    assert voxels.counts().occupied == 0
    assert free_z.min() == pytest.approx(0.21)
    assert free_z.max() == pytest.approx(0.31)


def test_a_return_beyond_the_maximum_range_frees_up_to_it_and_hits_nothing(
    voxels: VoxelMap,
) -> None:
    other = VoxelMap(RESOLUTION_M, LOW, HIGH)
    voxels.fuse_depth(np.full(SHAPE, 500, np.uint16), PINHOLE, looking_down(), max_range_m=0.4)
    other.fuse_depth(np.full(SHAPE, 65535, np.uint16), PINHOLE, looking_down(), max_range_m=0.4)
    assert voxels.counts().occupied == 0
    np.testing.assert_array_equal(dense_classes(voxels), dense_classes(other))


def test_log_odds_follow_bayes_and_stop_at_the_clamps(voxels: VoxelMap) -> None:
    hit, miss, low, high = voxels.sensor.fixed_point()
    image = step_image()
    surface, ahead = voxels.box.keys(np.array([(0.01, 0.01, 0.21), (0.01, 0.01, 0.29)]))
    for n in range(1, 12):
        voxels.fuse_depth(image, PINHOLE, looking_down())
        log_odds = voxels.log_odds_dense() * LOG_ODDS_SCALE
        assert log_odds[tuple(surface)] == min(n * hit, high)
        assert log_odds[tuple(ahead)] == max(n * miss, low)


def test_more_than_255_scans_still_update_every_voxel_once() -> None:
    weak = SensorModel(hit=0.5005, miss=0.4995, min=0.02, max=0.98)
    slow = VoxelMap(0.04, LOW, HIGH, weak)
    image = step_image()
    for _ in range(600):
        slow.fuse_depth(image, PINHOLE, looking_down())
    key = slow.box.keys(np.array([(0.01, 0.01, 0.21)]))[0]
    assert slow.log_odds_dense()[tuple(key)] * LOG_ODDS_SCALE == 600 * weak.fixed_point()[0]


def test_changes_lead_from_the_last_published_classes_to_the_present_ones(
    rng: np.random.Generator, voxels: VoxelMap
) -> None:
    mirror = dense_classes(voxels)
    for step in range(12):
        match step % 4:
            case 0 | 1:
                image = rng.integers(0, 900, SHAPE).astype(np.uint16)
                voxels.fuse_depth(image, PINHOLE, looking_down(rng.uniform(0.4, 0.8)))
            case 2:
                voxels.decay(1.0, 0.5)
            case 3:
                voxels.clear()
                voxels.fuse_depth(step_image(), PINHOLE, looking_down())
        changes = voxels.changes()
        before = mirror[tuple(changes[:, :3].T)]
        assert (before != changes[:, 3]).all()
        mirror = applied(changes, mirror)
        np.testing.assert_array_equal(mirror, dense_classes(voxels))
    assert len(voxels.changes()) == 0


def test_counts_and_entropy_are_those_of_the_dense_map(
    rng: np.random.Generator, voxels: VoxelMap
) -> None:
    for _ in range(3):
        image = rng.integers(0, 900, SHAPE).astype(np.uint16)
        voxels.fuse_depth(image, PINHOLE, looking_down(0.7))
    classes = dense_classes(voxels)
    assert voxels.counts() == tuple((classes == c).sum() for c in range(3))
    p = 1 / (1 + np.exp(-voxels.log_odds_dense()[classes > 0].astype(float)))
    bits = -p * np.log2(p) - (1 - p) * np.log2(1 - p)
    expected = bits.sum() + (classes == 0).sum()
    assert voxels.entropy_bits() == pytest.approx(expected, rel=1e-3)


def test_occupied_and_free_list_each_known_voxel_once_with_its_probability(
    voxels: VoxelMap,
) -> None:
    voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    occupied, free = voxels.occupied(), voxels.free()
    assert (len(free.centres_m), len(occupied.centres_m)) == voxels.counts()[1:]
    assert (voxels.classify(occupied.centres_m) == 2).all()
    assert (voxels.classify(free.centres_m) == 1).all()
    np.testing.assert_allclose(occupied.probability, 0.7, atol=1e-4)
    np.testing.assert_allclose(free.probability, 0.4, atol=1e-4)


def test_clear_forgets_everything_and_the_next_scan_is_as_on_a_new_map(voxels: VoxelMap) -> None:
    fresh = VoxelMap(RESOLUTION_M, LOW, HIGH)
    for _ in range(3):
        voxels.fuse_depth(step_image(), PINHOLE, looking_down())
        voxels.clear()
        assert voxels.counts() == fresh.counts()
    voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    fresh.fuse_depth(step_image(), PINHOLE, looking_down())
    np.testing.assert_array_equal(voxels.log_odds_dense(), fresh.log_odds_dense())


def test_decay_halves_log_odds_and_ends_in_unknown(voxels: VoxelMap) -> None:
    voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    before = voxels.log_odds_dense()
    voxels.decay(0.5, 0.5)
    np.testing.assert_allclose(voxels.log_odds_dense(), before / 2, atol=2 / LOG_ODDS_SCALE)
    for _ in range(6):
        voxels.decay(0.5, 0.5)
    assert voxels.counts() == (voxels.box.num_voxels, 0, 0)


def test_two_steps_of_decay_are_one_of_their_sum(voxels: VoxelMap) -> None:
    other = VoxelMap(RESOLUTION_M, LOW, HIGH)
    for m in (voxels, other):
        m.fuse_depth(step_image(), PINHOLE, looking_down())
    voxels.decay(0.1, 1.0)
    voxels.decay(0.2, 1.0)
    other.decay(0.3, 1.0)
    np.testing.assert_allclose(
        voxels.log_odds_dense(), other.log_odds_dense(), atol=3 / LOG_ODDS_SCALE
    )


def test_many_views_are_the_views_one_by_one(voxels: VoxelMap) -> None:
    other = VoxelMap(RESOLUTION_M, LOW, HIGH)
    heights = (0.5, 0.6, 0.7)
    views = [View(step_image(), PINHOLE, looking_down(h), 0.001, 10.0) for h in heights]
    voxels.fuse_many(views)
    for h in heights:
        other.fuse_depth(step_image(), PINHOLE, looking_down(h))
    np.testing.assert_array_equal(voxels.log_odds_dense(), other.log_odds_dense())


def test_memory_grows_with_what_is_seen_and_not_with_the_box() -> None:
    large = VoxelMap(0.02, (-5, -5, -1), (5, 5, 1))
    empty = large.num_bytes
    large.fuse_depth(step_image(), PINHOLE, looking_down())
    assert large.num_bytes < empty + (1 << 20)
    assert large.num_bytes < large.box.num_voxels / 8


def test_a_saved_map_is_read_back_as_it_was(voxels: VoxelMap, tmp_path) -> None:
    for _ in range(2):
        voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    voxels.save(tmp_path / "map.npz")
    loaded = VoxelMap.load(tmp_path / "map.npz")
    np.testing.assert_array_equal(loaded.log_odds_dense(), voxels.log_odds_dense())
    assert (loaded.box, loaded.sensor) == (voxels.box, voxels.sensor)
    for m in (voxels, loaded):
        m.fuse_depth(step_image(), PINHOLE, looking_down(0.55))
    np.testing.assert_array_equal(loaded.log_odds_dense(), voxels.log_odds_dense())


def test_a_ply_holds_the_occupied_voxels(voxels: VoxelMap, tmp_path) -> None:
    voxels.fuse_depth(step_image(), PINHOLE, looking_down())
    voxels.save(tmp_path / "map.ply")
    header, body = (tmp_path / "map.ply").read_bytes().split(b"end_header\n", 1)
    vertices = np.frombuffer(body, "<f4").reshape(-1, 4)
    assert f"element vertex {voxels.counts().occupied}\n".encode() in header
    np.testing.assert_allclose(vertices[:, :3], voxels.occupied().centres_m, atol=1e-6)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 cut"])
def test_a_file_that_is_no_map_is_refused(content: bytes, tmp_path) -> None:
    (tmp_path / "map.npz").write_bytes(content)
    with pytest.raises(BadMapFile, match=r"map\.npz"):
        VoxelMap.load(tmp_path / "map.npz")


def test_an_unknown_format_is_refused_with_the_known_ones(voxels: VoxelMap, tmp_path) -> None:
    with pytest.raises(BadMapFile, match=r"'\.xyz'.*\.npz, \.ply"):
        voxels.save(tmp_path / "map.xyz")


def scaled(factor: float) -> np.ndarray:
    T = looking_down()
    T[:3, :3] *= factor
    return T


def mirrored() -> np.ndarray:
    return np.diag([1.0, 1.0, -1.0, 1.0])


NAN_POSE = np.full((4, 4), np.nan)
GOOD = step_image()


@pytest.mark.parametrize(
    ("depth", "pinhole", "pose", "scale", "max_range", "error"),
    [
        (GOOD, PINHOLE, scaled(1.01), 0.001, 10.0, BadPose),
        (GOOD, PINHOLE, mirrored(), 0.001, 10.0, BadPose),
        (GOOD, PINHOLE, NAN_POSE, 0.001, 10.0, BadPose),
        (GOOD, PINHOLE, np.eye(3), 0.001, 10.0, BadPose),
        (GOOD.astype(np.float32), PINHOLE, looking_down(), 0.001, 10.0, BadDepth),
        (GOOD[0], PINHOLE, looking_down(), 0.001, 10.0, BadDepth),
        (GOOD[:0], PINHOLE, looking_down(), 0.001, 10.0, BadDepth),
        (GOOD.tolist(), PINHOLE, looking_down(), 0.001, 10.0, BadDepth),
        (GOOD, PINHOLE, looking_down(), 0.0, 10.0, BadDepth),
        (GOOD, PINHOLE, looking_down(), 0.001, math.nan, BadDepth),
        (GOOD, (0.0, 90.0, 40.0, 30.0), looking_down(), 0.001, 10.0, BadIntrinsics),
        (GOOD, (90.0, 90.0, math.inf, 30.0), looking_down(), 0.001, 10.0, BadIntrinsics),
        (GOOD, (90.0, 90.0), looking_down(), 0.001, 10.0, BadIntrinsics),
    ],
)
def test_a_bad_view_is_refused_and_the_map_is_as_it_was(
    voxels: VoxelMap, depth, pinhole, pose, scale, max_range, error
) -> None:
    voxels.fuse_depth(GOOD, PINHOLE, looking_down())
    before = voxels.log_odds_dense()
    good = View(GOOD, PINHOLE, looking_down(), 0.001, 10.0)
    with pytest.raises(error):
        voxels.fuse_depth(depth, pinhole, pose, scale, max_range)
    with pytest.raises(error):
        voxels.fuse_many([good, View(depth, pinhole, pose, scale, max_range)])
    np.testing.assert_array_equal(voxels.log_odds_dense(), before)


@pytest.mark.parametrize(
    ("points", "origin", "max_range"),
    [
        (np.zeros((3, 2)), (0, 0, 0), 1.0),
        (np.zeros(3), (0, 0, 0), 1.0),
        (np.zeros((1, 3)), (0, 0, math.nan), 1.0),
        (np.zeros((1, 3)), (0, 0), 1.0),
        (np.zeros((1, 3)), (0, 0, 0), 0.0),
        (np.zeros((1, 3)), (0, 0, 0), math.nan),
    ],
)
def test_bad_points_are_refused_and_the_map_is_as_it_was(
    voxels: VoxelMap, points, origin, max_range
) -> None:
    with pytest.raises(BadPoints):
        voxels.fuse_points(points, origin, max_range)
    assert voxels.counts().unknown == voxels.box.num_voxels


@pytest.mark.parametrize(
    ("resolution", "low", "high", "error", "says"),
    [
        (0.01, (0, 0, 0), (1, 1, 0), BadBox, "volume"),
        (0.01, (0, 0, 0), (1, 1, math.nan), BadBox, "finite"),
        (0.01, (0, 0), (1, 1), BadBox, "shapes"),
        (0.0, (0, 0, 0), (1, 1, 1), BadBox, "voxel size 0.0"),
        (math.nan, (0, 0, 0), (1, 1, 1), BadBox, "voxel size"),
        (0.0001, (0, 0, 0), (10, 10, 10), MapTooLarge, "GiB"),
        (0.01, (0, 0, 0), (400, 0.1, 0.1), MapTooLarge, "32767 voxels per axis"),
    ],
)
def test_a_box_that_is_none_or_too_large_is_refused(resolution, low, high, error, says) -> None:
    with pytest.raises(error, match=says):
        VoxelMap(resolution, low, high)


def test_the_box_is_snapped_outward_and_bounds_on_the_lattice_stay() -> None:
    box = VoxelMap(0.01, (-0.6, -0.6, -0.1), (0.6, 0.6, 0.7)).box
    assert box.shape == (120, 120, 80)
    np.testing.assert_allclose(box.origin_m, (-0.6, -0.6, -0.1))
    box = VoxelMap(0.01, (-0.605, 0, 0), (0.001, 0.01, 0.01)).box
    assert box.shape == (64, 8, 8)
    assert box.origin_m[0] == pytest.approx(-0.61)


@pytest.mark.parametrize(
    "odds", [{"hit": 0.4}, {"miss": 0.6}, {"min": 0.0}, {"max": 1.0}, {"max": 0.999}]
)
def test_probabilities_that_are_no_sensor_model_are_refused(odds: dict[str, float]) -> None:
    with pytest.raises(BadSensorModel):
        SensorModel(**odds)


@pytest.mark.parametrize(("dt", "half_life"), [(-1.0, 1.0), (1.0, 0.0), (math.nan, 1.0)])
def test_a_time_that_is_none_is_refused(voxels: VoxelMap, dt: float, half_life: float) -> None:
    with pytest.raises(BadDecay):
        voxels.decay(dt, half_life)
