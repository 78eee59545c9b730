"""The projective integrator keeps OctoMap's rules; its free space is OctoMap's but for the rim."""

import numpy as np
import pytest

from benchmarks.mapping_scene import camera_pose, depth_image, points
from services.kernels import levels
from services.mapper.voxel_map import VoxelMap
from tests.octomap_reference import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    classes_in,
    classes_of,
    inserted,
    iou,
    log_odds_in,
)

pytestmark = pytest.mark.unit

FOCAL_PX = 579.0
SHAPE = (480, 640)
PINHOLE = (FOCAL_PX, FOCAL_PX, 319.5, 239.5)
LOW, HIGH = (-0.6, -0.6, -0.1), (0.6, 0.6, 0.7)
AGREEMENT, OCCUPIED_IOU, FREE_IOU, OVER_CARVED = 0.999, 0.995, 0.97, 0.005


def ring(num_cameras: int, empty: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(3)
    poses = [camera_pose(0.13 + k * np.pi / 3, 1.03, 0.58, 0.2) for k in range(num_cameras)]
    return [(depth_image(SHAPE, PINHOLE, T, rng, empty), T) for T in poses]


def test_it_agrees_with_octomap_within_the_contract() -> None:
    views = ring(3)
    ours = VoxelMap(0.01, LOW, HIGH)
    for image, T in views:
        ours.fuse_depth(image, PINHOLE, T)
    scans = [(points(image, PINHOLE, T), T[:3, 3]) for image, T in views]
    theirs = classes_of(log_odds_in(inserted(0.01, scans), ours.box))
    mine = classes_in(ours)
    both = (mine != UNKNOWN) & (theirs != UNKNOWN)
    assert (mine == theirs)[both].mean() >= AGREEMENT
    assert iou(mine, theirs, OCCUPIED) >= OCCUPIED_IOU
    assert iou(mine, theirs, FREE) >= FREE_IOU
    assert ((mine == FREE) & (theirs == UNKNOWN)).sum() <= OVER_CARVED * (theirs == FREE).sum()


@pytest.mark.parametrize("resolution", [0.04, 0.02])
def test_a_noisy_image_hits_the_voxels_its_points_lie_in(resolution: float) -> None:
    image, T = ring(1)[0]
    image = np.ascontiguousarray(image[::2, ::2])
    pinhole = (FOCAL_PX / 2, FOCAL_PX / 2, 159.5, 119.5)
    ours = VoxelMap(resolution, LOW, HIGH)
    ours.fuse_depth(image, pinhole, T)
    keys = np.unique(ours.box.keys(points(image, pinhole, T)), axis=0)
    keys = keys[((keys >= 0) & (keys < ours.box.shape)).all(axis=1)]
    found = np.argwhere(classes_in(ours) == OCCUPIED)
    agreeing = set(map(tuple, keys)) & set(map(tuple, found))
    # Single precision moves a few points across a voxel's face.
    assert len(agreeing) >= 0.999 * max(len(keys), len(found))


def test_every_voxel_is_updated_once_and_a_hit_beats_a_miss() -> None:
    image, T = ring(1, empty=65535)[0]
    ours = VoxelMap(0.02, LOW, HIGH)
    ours.fuse_depth(image, PINHOLE, T)
    hit, miss, _, _ = ours.sensor.fixed_point()
    values = np.unique(ours.log_odds_dense()[classes_in(ours) != UNKNOWN] * 8192)
    assert values.tolist() == [miss, hit]


@pytest.mark.parametrize(("raw", "hits"), [(999, True), (1000, True), (1001, False)])
def test_a_return_at_the_range_limit_counts_and_one_beyond_it_only_carves(
    raw: int, hits: bool
) -> None:
    ours = VoxelMap(0.05, (-0.5, -0.5, 0.0), (0.5, 0.5, 1.5))
    image = np.full((48, 64), raw, np.uint16)
    fused = ours.fuse_depth(image, (60.0, 60.0, 31.5, 23.5), np.eye(4), 0.001, 1.0)
    assert (fused.num_hits > 0) == (ours.counts().occupied > 0) == hits
    assert ours.counts().free > 0


def test_a_camera_inside_the_box_frees_what_is_before_it_alone() -> None:
    ours = VoxelMap(0.02, LOW, HIGH)
    T = np.eye(4)
    ours.fuse_depth(np.full(SHAPE, 65535, np.uint16), PINHOLE, T, max_range_m=0.5)
    free = ours.free().centres_m
    u = FOCAL_PX * free[:, 0] / free[:, 2] + 319.5
    v = FOCAL_PX * free[:, 1] / free[:, 2] + 239.5
    assert (free[:, 2] > 0).all()
    assert (free[:, 2] < 0.5).all()
    assert ((u > -1) & (u < 640) & (v > -1) & (v < 480)).all()
    assert len(free) > 0.5 * 640 * 480 * 0.5**3 / 3 / FOCAL_PX**2 / 0.02**3


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (47, 63), (480, 1), (7, 640)])
def test_images_of_any_size_are_fused(shape: tuple[int, int]) -> None:
    ours = VoxelMap(0.02, LOW, HIGH)
    pinhole = (60.0, 60.0, (shape[1] - 1) / 2, (shape[0] - 1) / 2)
    ours.fuse_depth(np.full(shape, 1000, np.uint16), pinhole, camera_pose(0.3, 1.0, 0.5, 0.2))
    assert ours.counts().occupied >= 1
    assert ours.counts().free >= 1


def test_turning_world_and_camera_together_by_a_quarter_leaves_the_map_turned() -> None:
    low, high = (-0.64, -0.64, 0.0), (0.64, 0.64, 0.64)
    image, T = ring(1)[0]
    quarter = np.eye(4)
    quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    one, turned = VoxelMap(0.02, low, high), VoxelMap(0.02, low, high)
    one.fuse_depth(image, PINHOLE, T)
    turned.fuse_depth(image, PINHOLE, quarter @ T)
    back = np.rot90(classes_in(turned), -1, axes=(0, 1))
    assert (back == classes_in(one)).mean() > 0.9999


def test_fusing_is_the_same_to_the_last_bit_on_every_run() -> None:
    views = ring(3, empty=65535)
    maps = [VoxelMap(0.01, LOW, HIGH) for _ in range(2)]
    for ours in maps:
        for image, T in views:
            ours.fuse_depth(image, PINHOLE, T)
    np.testing.assert_array_equal(*(ours.log_odds_dense() for ours in maps))


def windowed_max(image: np.ndarray, before: int, after: int) -> np.ndarray:
    """Numpy twin: max over [u - before, u + after] on both axes, the image's edge repeated."""
    pads = [(before, after), (before, after)]
    padded = np.pad(image, pads, mode="edge")
    width = before + after + 1
    return np.lib.stride_tricks.sliding_window_view(padded, (width, width)).max(axis=(2, 3))


@pytest.mark.parametrize("shape", [(8, 8), (7, 9), (1, 5), (2, 1)])
def test_sliding_maxima_are_those_of_numpy(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(4).integers(0, 65536, shape).astype(np.uint16)
    even = np.empty((shape[0] + 1, shape[1] + 1), np.uint16)
    odd = np.empty(shape, np.uint16)
    levels.widen_to_even(image, even)
    levels.widen_to_odd(even, odd)
    np.testing.assert_array_equal(even, windowed_max(np.pad(image, 1, mode="edge"), 1, 0)[1:, 1:])
    np.testing.assert_array_equal(odd, windowed_max(image, 1, 1))


@pytest.mark.parametrize("shape", [(8, 8), (7, 9), (1, 5), (2, 1), (17, 33)])
def test_halving_and_tiles_are_those_of_numpy(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(5).integers(0, 65536, shape).astype(np.uint16)
    limit = np.uint16(40000)
    rows, columns = -(-shape[0] // 2), -(-shape[1] // 2)
    half = np.empty((rows, columns), np.uint16)
    levels.halve(image, limit, half)
    odd = np.pad(image, [(0, 2 * rows - shape[0]), (0, 2 * columns - shape[1])], mode="edge")
    expected = np.minimum(odd.reshape(rows, 2, columns, 2).max(axis=(1, 3)), limit)
    np.testing.assert_array_equal(half, expected)
    tiles = (-(-rows // 4), -(-columns // 4))
    nearest, farthest = np.empty(tiles, np.uint16), np.empty(tiles, np.uint16)
    levels.tiles(half, nearest, farthest)
    for a, b in np.ndindex(tiles):
        part = half[4 * a : 4 * a + 4, 4 * b : 4 * b + 4]
        assert (nearest[a, b], farthest[a, b]) == (part.min(), part.max())


def test_the_level_asked_for_has_the_window_closest_in_width() -> None:
    for pixels in np.linspace(0.2, 60, 300):
        level = int(levels.level_for(np.float32(pixels)))
        cells = int(levels.cells_of(level))
        width = cells if level < levels.NUM_FINE else 2 * cells
        assert abs(width - max(pixels, 1)) <= 1.0 + 1e-4
