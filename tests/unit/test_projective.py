"""The projective integrator keeps OctoMap's rules; its free space is OctoMap's but for the rim."""

import math

import numpy as np
import pytest

from benchmarks.mapping_scene import camera_pose, depth_image, points
from services.mapper.errors import BadThreads
from services.mapper.look import Look
from services.mapper.view import View
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
    # A voxel at the rim is seen by half: its centre may lie beside the image.
    half_px = 0.5 * FOCAL_PX * 0.02 / free[:, 2] + 2.0
    assert ((u > -half_px) & (u < 639 + half_px) & (v > -half_px) & (v < 479 + half_px)).all()
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


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize("half_life_s", [math.inf, 0.5])
def test_many_threads_make_the_map_of_one_to_the_last_bit(threads: int, half_life_s: float) -> None:
    views = [View(image, PINHOLE, T, 0.001, 10.0) for image, T in ring(6, empty=65535)]
    one, many = (VoxelMap(0.02, LOW, HIGH) for _ in range(2))
    for shown in (views[:5], views[2:], views):
        fused = one.fuse_many(shown), many.fuse_many(shown, threads)
        assert fused[0] == fused[1]
        np.testing.assert_array_equal(one.log_odds_dense(), many.log_odds_dense())
        for ours in (one, many):
            ours.decay(0.1, half_life_s)


def test_a_number_of_threads_that_is_none_is_refused() -> None:
    ours = VoxelMap(0.02, LOW, HIGH)
    for threads in (0, -1, 65, 1.5):
        with pytest.raises(BadThreads, match="whole number from 1 to 64"):
            ours.fuse_many([], threads)


@pytest.mark.parametrize("focal_px", [(1.5, 1.5), (7.0, 7.0), (12.0, 9.0), (300.0, 0.5)])
@pytest.mark.parametrize("resolution", [0.1, 0.35, 1.0])
def test_a_camera_of_few_pixels_inside_the_box_frees_what_it_sees(
    focal_px: tuple[float, float], resolution: float
) -> None:
    ours = VoxelMap(resolution, (-8, -8, -8), (8, 8, 8))
    rng = np.random.default_rng(1)
    for _ in range(5):
        T = camera_pose(rng.uniform(0, 6), rng.uniform(0.1, 4), rng.uniform(0.1, 2), 0.3)
        image = rng.choice([0, 900, 5000, 65535], (16, 16)).astype(np.uint16)
        ours.fuse_depth(image, (*focal_px, 7.5, 7.5), T, max_range_m=6.0)
        free = ours.free().centres_m
        assert len(free) > 0 or focal_px[0] > 100  # Then a voxel may be larger than the image.
        # What is free lies within the maximum range of a camera so far, and its voxel's edge.
        assert (
            np.abs(free).max(initial=0.0)
            < 4 + 2 + 6 * np.hypot(1, 8 / min(focal_px)) + 2 * resolution
        )


class Interrupted(Exception):
    """What ends a step in its middle."""


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("step", ["list_bricks", "apply"])
def test_an_interrupted_fuse_leaves_nothing_for_the_next(
    monkeypatch: pytest.MonkeyPatch, threads: int, step: str
) -> None:
    views = [View(image, PINHOLE, T, 0.001, 10.0) for image, T in ring(2, empty=65535)]
    ours, clean = (VoxelMap(0.02, LOW, HIGH) for _ in range(2))

    def interrupted(*_: object) -> int:
        raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(Look, step, interrupted)
        with pytest.raises(Interrupted):
            ours.fuse_many(views, threads)
    assert ours.num_open == 0
    assert ours.fuse_many(views, threads) == clean.fuse_many(views, threads)
    np.testing.assert_array_equal(ours.log_odds_dense(), clean.log_odds_dense())
    assert ours.num_open == clean.num_open


def test_every_whole_range_counts_its_last_unit() -> None:
    for millimetres in range(1, 3000, 7):
        view = View(np.zeros((1, 1), np.uint16), PINHOLE, np.eye(4), 0.001, millimetres / 1000)
        assert view.limit == millimetres
