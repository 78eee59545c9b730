"""Colors beside the occupancy: means of what was seen, of the bricks that are there."""

import numpy as np
import pytest

from services.kernels.colors import MOST, UNIT
from services.kernels.rigid import apply, inverse, look_at
from services.mapper.colors import Colors
from services.mapper.errors import BadColor
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

LOW, HIGH = (-0.48, -0.32, -0.32), (0.48, 0.32, 0.32)
PINHOLE = (90.0, 90.0, 39.5, 29.5)
SHAPE = (60, 80)
RED, BLUE, WHITE = (200, 10, 10), (10, 10, 200), (255, 255, 255)
RADIUS_M = 0.12
CENTRES_M = {RED: np.array((-0.25, 0.0, 0.0)), BLUE: np.array((0.25, 0.0, 0.0))}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture
def voxels() -> VoxelMap:
    return VoxelMap(0.02, LOW, HIGH)


def looking_down(height_m: float = 0.9) -> np.ndarray:
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = height_m
    return T


def spheres_from(T_map_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth, mm, and picture of a red and a blue sphere before nothing."""
    v, u = np.indices(SHAPE)
    fx, fy, cx, cy = PINHOLE
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(SHAPE)], axis=-1)
    depth, color = np.full(SHAPE, np.inf), np.full((*SHAPE, 3), 77, np.uint8)
    for paint, centre_m in CENTRES_M.items():
        centre = apply(inverse(T_map_camera), centre_m[None])[0]
        a, b = (rays**2).sum(axis=-1), rays @ centre
        inside = b**2 - a * (centre @ centre - RADIUS_M**2)
        z = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
        nearer = z < depth
        depth[nearer], color[nearer] = z[nearer], paint
    return np.where(np.isinf(depth), 65535, np.round(depth * 1000)).astype(np.uint16), color


def flat(color: tuple[int, int, int]) -> np.ndarray:
    return np.full((*SHAPE, 3), color, np.uint8)


FLOOR = np.full(SHAPE, 900, np.uint16)  # at z = 0 from looking_down().


def test_a_red_and_a_blue_sphere_seen_by_two_cameras_are_red_and_blue(voxels: VoxelMap) -> None:
    for eye in ((0.1, -0.9, 0.3), (-0.1, 0.8, 0.4)):
        T = look_at(eye, (0, 0, 0))
        depth, color = spheres_from(T)
        voxels.fuse_depth(depth, PINHOLE, T, color=color)
    centres_m, colors = voxels.occupied().centres_m, voxels.colors()
    assert len(centres_m) == len(colors) > 200
    for paint, centre_m in CENTRES_M.items():
        near = np.linalg.norm(centres_m - centre_m, axis=1) < RADIUS_M + 0.03
        assert near.sum() > 100
        assert (colors[near] == paint).all()


def test_colors_never_change_the_occupancy(rng: np.random.Generator, voxels: VoxelMap) -> None:
    plain = VoxelMap(0.02, LOW, HIGH)
    for step in range(8):
        depth = rng.integers(0, 1300, SHAPE).astype(np.uint16)
        color = rng.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
        T = looking_down(rng.uniform(0.5, 1.0))
        plain.fuse_depth(depth, PINHOLE, T)
        voxels.fuse_depth(depth, PINHOLE, T, color=color)
        if step == 4:
            for each in (plain, voxels):
                each.decay(0.5, 1.0)
                each.move_to((0.2, 0.0, 0.0), 0.5)
        np.testing.assert_array_equal(plain.changes(), voxels.changes())
        np.testing.assert_array_equal(plain.log_odds_dense(), voxels.log_odds_dense())
    assert not plain.is_colored
    assert voxels.is_colored


def test_a_voxels_color_is_the_running_mean_of_the_pixels_that_end_in_it(rng, voxels) -> None:
    sums: dict[tuple[int, ...], list[np.ndarray]] = {}
    fx, fy, cx, cy = PINHOLE
    for _ in range(3):
        depth = rng.integers(0, 1100, SHAPE).astype(np.uint16)
        color = rng.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
        T = looking_down(rng.uniform(0.6, 1.0))
        voxels.fuse_depth(depth, PINHOLE, T, color=color, max_range_m=1.0)
        v, u = np.nonzero((depth > 0) & (depth <= 1000))
        z = depth[v, u] * 0.001
        points = apply(T, np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1))
        at = (points - voxels.box.origin_m) / voxels.box.resolution_m
        sure = (np.abs(at - np.round(at)) > 1e-3).all(axis=1)
        for key, seen, fine in zip(voxels.box.keys(points), color[v, u], sure, strict=True):
            sums.setdefault(tuple(key), []).append(seen if fine else np.full(3, np.nan))
    occupied = voxels.box.keys(voxels.occupied().centres_m)
    checked = 0
    for key, color in zip(occupied, voxels.colors(), strict=True):
        mean = np.mean(sums.get(tuple(key), [np.full(3, np.nan)]), axis=0)
        if not np.isnan(mean).any():
            assert np.abs(color - mean).max() < 1.0
            checked += 1
    assert checked > 500


def test_the_mean_of_noisy_looks_converges(rng: np.random.Generator, voxels: VoxelMap) -> None:
    true = np.array((90, 120, 180))
    for _ in range(60):
        noise = rng.normal(0, 25, (*SHAPE, 3))
        color = np.clip(true + noise, 0, 255).round().astype(np.uint8)
        voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=color)
    # An average over 255 pixels of 25 is 25 / sqrt(2 * 255) off, in the mean over the last ones.
    assert np.abs(voxels.colors().mean(axis=0) - true).max() < 1.0
    assert np.abs(voxels.colors() - true).std() < 3.0


def test_a_color_that_changes_for_good_is_taken_over(voxels: VoxelMap) -> None:
    for _ in range(100):
        voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=flat(RED))
    assert (voxels.colors() == RED).all()
    for _ in range(600):
        voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=flat(BLUE))
    assert np.abs(voxels.colors().astype(int) - BLUE).max() <= 1 + MOST // UNIT


@pytest.mark.parametrize("forgetting", ["clear", "decay", "carve", "move"])
def test_a_brick_that_was_closed_has_forgotten_its_colors(voxels: VoxelMap, forgetting) -> None:
    voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=flat(RED))
    match forgetting:
        case "clear":
            voxels.clear()
        case "decay":
            voxels.decay(100.0, 1.0)
            voxels.changes()
        case "carve":
            for _ in range(30):
                voxels.fuse_depth(np.full(SHAPE, 65535, np.uint16), PINHOLE, looking_down(1.6))
        case "move":
            voxels.move_to((50.0, 0.0, 0.0))
            voxels.move_to((0.0, 0.0, 0.0))
    assert len(voxels.colors()) == 0
    for _ in range(4):
        voxels.fuse_depth(FLOOR, PINHOLE, looking_down())
    assert voxels.counts().occupied > 100
    assert (voxels.colors() == WHITE).all()


def test_a_window_that_moves_keeps_the_colors_of_what_stays(voxels: VoxelMap) -> None:
    T = look_at((0.1, -0.9, 0.3), (0, 0, 0))
    depth, color = spheres_from(T)
    voxels.fuse_depth(depth, PINHOLE, T, color=color)
    assert voxels.move_to((0.2, 0.0, 0.0), 0.5)
    for _ in range(2):
        centres_m, colors = voxels.occupied().centres_m, voxels.colors()
        near = np.linalg.norm(centres_m - CENTRES_M[BLUE], axis=1) < RADIUS_M + 0.03
        assert near.sum() > 50
        assert (colors[near] == BLUE).all()
        voxels.fuse_depth(depth, PINHOLE, T)  # Slots of what left are used by what entered.


def test_what_comes_back_from_the_archive_has_no_color_and_not_that_of_others() -> None:
    voxels = VoxelMap(0.02, LOW, HIGH, archive=True)
    voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=flat(RED))
    voxels.move_to((50.0, 0.0, 0.0))
    assert (voxels.colors() == WHITE).all()
    far = looking_down()
    far[0, 3] = 50.0
    voxels.fuse_depth(FLOOR, PINHOLE, far, color=flat(BLUE))
    voxels.move_to((0.0, 0.0, 0.0))
    assert len(voxels.colors()) == len(voxels.occupied().centres_m)
    assert (voxels.colors() == WHITE).all()


def test_the_pool_of_colors_grows_with_that_of_bricks_and_is_counted(rng) -> None:
    voxels = VoxelMap(0.01, LOW, HIGH)
    before = voxels.num_bytes
    depth = np.full(SHAPE, 0, np.uint16)
    for row in range(0, SHAPE[0], 10):
        depth[row : row + 10] = rng.integers(700, 1100, (10, SHAPE[1]))
        voxels.fuse_depth(depth, PINHOLE, looking_down(), color=flat(RED))
    assert (voxels.colors() == RED).all()
    plain = VoxelMap(0.01, LOW, HIGH)
    plain.fuse_depth(depth, PINHOLE, looking_down())
    assert voxels.num_bytes - before > 3 * (plain.num_bytes - before)


def test_colors_are_stored_and_come_back(voxels: VoxelMap, tmp_path) -> None:
    T = look_at((0.1, -0.9, 0.3), (0, 0, 0))
    depth, color = spheres_from(T)
    voxels.fuse_depth(depth, PINHOLE, T, color=color)
    voxels.save(tmp_path / "map.npz")
    loaded = VoxelMap.load(tmp_path / "map.npz")
    assert loaded.is_colored
    np.testing.assert_array_equal(loaded.colors(), voxels.colors())
    assert not np.array_equal(loaded.colors(), np.full_like(loaded.colors(), 255))


def test_a_map_that_takes_in_one_without_colors_forgets_its_own(voxels: VoxelMap) -> None:
    voxels.fuse_depth(FLOOR, PINHOLE, looking_down())
    plain = voxels.stored()
    voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=flat(RED))
    assert (voxels.colors() != 255).any()
    voxels.take_in(plain)
    assert len(voxels.colors()) > 0
    assert (voxels.colors() == 255).all()


def test_a_map_without_pictures_stores_no_colors(voxels: VoxelMap) -> None:
    voxels.fuse_depth(FLOOR, PINHOLE, looking_down())
    assert voxels.stored().color is None
    assert (voxels.colors() == WHITE).all()


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((*SHAPE, 4), np.uint8),
        np.zeros(SHAPE, np.uint8),
        np.zeros((*SHAPE[::-1], 3), np.uint8),
        np.zeros((*SHAPE, 3), np.float32),
        [[0, 0, 0]],
    ],
)
def test_a_picture_that_is_not_the_depth_images_is_refused(voxels: VoxelMap, picture) -> None:
    with pytest.raises(BadColor, match=r"must be a uint8 array of shape \(60, 80, 3\)"):
        voxels.fuse_depth(FLOOR, PINHOLE, looking_down(), color=picture)
    assert voxels.counts().unknown == voxels.box.num_voxels
    assert not voxels.is_colored


def test_colors_hold_nothing_before_the_first_picture() -> None:
    assert Colors().num_bytes == 0
