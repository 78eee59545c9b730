"""Every kernel of the mapper does what its slow and obvious numpy twin does.

Twins of projections and rays are written in double precision; a voxel whose answer would change
within the kernel's single precision is left out, and there must be few of them.
"""

import itertools

import numpy as np
import pytest

from services.kernels import bricks, carve, classes, hits
from services.kernels.bricks import UNKNOWN, VOXELS
from services.kernels.rigid import apply, inverse, look_at
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.exact import ExactIntegrator
from services.mapper.projective import FOOTPRINT, MARGIN, NO_RETURN, ProjectiveIntegrator, View
from services.mapper.sensor_model import SensorModel

pytestmark = pytest.mark.unit

BOX = Box(0.02, (-20, -20, 0), (5, 5, 4))
LOW_M = np.array(BOX.first_key) * BOX.resolution_m
CORNERS_M = LOW_M + np.moveaxis(np.indices(BOX.shape), 0, -1) * BOX.resolution_m
INDEX = np.argwhere(np.ones(BOX.num_bricks)).astype(np.int16)
SENSOR = SensorModel()
HIT, MISS, LOW, HIGH = SENSOR.fixed_point()
NEAR_BORDER = 1e-3  # voxels or pixels: ten times what single precision moves a projection.
NEAR_M = 1e-5  # a hundred times what single precision moves a depth or a ray.


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def random_log_odds(rng: np.random.Generator) -> np.ndarray:
    """(B, 512): a quarter each of unknown, lowest, uniform and mixed bricks."""
    mixed = rng.integers(LOW, HIGH + 1, (len(INDEX), VOXELS))
    mixed[rng.random(mixed.shape) < 0.3] = UNKNOWN
    uniform = rng.integers(LOW, HIGH + 1, (len(INDEX), 1))
    kind = rng.integers(0, 4, (len(INDEX), 1))
    return np.choose(kind, [UNKNOWN, LOW, uniform, mixed]).astype(np.int16)


def random_map(rng: np.random.Generator) -> tuple[BrickStore, np.ndarray]:
    """A store, and (nx, ny, nz) what it was given."""
    store, log_odds = BrickStore(BOX.num_bricks), random_log_odds(rng)
    store.restore(INDEX, log_odds)
    blocks = log_odds.reshape(*BOX.num_bricks, 8, 8, 8)
    return store, blocks.transpose(0, 3, 1, 4, 2, 5).reshape(BOX.shape)


def expanded(store: BrickStore) -> np.ndarray:
    out = np.empty(BOX.shape, np.int16)
    classes.expand(store.bricks, out)
    return out


def added(log_odds: np.ndarray, update: int) -> np.ndarray:
    prior = np.where(log_odds == UNKNOWN, 0, log_odds.astype(np.int64))
    return np.clip(prior + update, LOW, HIGH)


def class_of(log_odds: np.ndarray) -> np.ndarray:
    return np.where(log_odds == UNKNOWN, 0, np.where(log_odds >= 0, 2, 1))


def assert_updated(
    store: BrickStore, prior: np.ndarray, hit: np.ndarray, free: np.ndarray, unsure: np.ndarray
) -> None:
    """Once per voxel, and a hit beats a miss."""
    expected = np.where(hit, added(prior, HIT), np.where(free, added(prior, MISS), prior))
    sure = hit | ~unsure
    assert sure.mean() > 0.98
    np.testing.assert_array_equal(expanded(store)[sure], expected[sure])


def test_updates_of_one_voxel_and_of_rows_add_and_clamp(rng: np.random.Generator) -> None:
    for row in random_log_odds(rng)[:30]:
        free, stamp = rng.integers(0, 2, (2, VOXELS)).astype(np.int32)
        np.testing.assert_array_equal([bricks.add(x, HIT, LOW, HIGH) for x in row], added(row, HIT))
        all_missed, some_missed, spared = row.copy(), row.copy(), free.copy()
        assert bricks.miss_row(all_missed, MISS, LOW) == (added(row, MISS) != LOW).sum()
        np.testing.assert_array_equal(all_missed, added(row, MISS))
        carve.spare_stamped(spared, stamp.astype(np.uint8), np.uint8(1))
        expected = np.where((free == 1) & (stamp != 1), added(row, MISS), row)
        assert carve.miss_some(some_missed, spared, MISS, LOW) == (expected != LOW).sum()
        np.testing.assert_array_equal(some_missed, expected)


def test_a_pixel_is_dropped_if_one_of_five_before_it_ends_alike(rng: np.random.Generator) -> None:
    here, above = rng.integers(-1, 6, (2, 300)).astype(np.int32)
    keep = np.empty(300 - 2 * hits.PAD, np.int32)
    hits.first_of_neighbours(here, above, keep)
    for n, kept in enumerate(keep, start=hits.PAD):
        before = {*here[n - 2 : n], *above[n - 1 : n + 2]}
        assert kept == (here[n] >= 0 and here[n] not in before)


def voxels_hit(view: View) -> tuple[np.ndarray, np.ndarray]:
    """(nx, ny, nz) whether a return ends in a voxel, (H, W) pixels too near a border to tell."""
    v, u = np.indices(view.depth.shape)
    fx, fy, cx, cy = view.pinhole
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=-1)
    points_m = apply(view.T_map_camera, rays * view.depth[..., None] * view.scale_m)
    at = (points_m - LOW_M) / BOX.resolution_m
    ends = (view.depth > 0) & (view.depth <= round(view.max_range_m / view.scale_m))
    ends &= ((at >= 0) & (at < BOX.shape)).all(axis=-1)
    hit = np.zeros(BOX.shape, bool)
    hit[tuple(at[ends].astype(int).T)] = True
    return hit, (np.abs(at - np.round(at)) < NEAR_BORDER).any(axis=-1)


def farthest(reach: np.ndarray, width_px: float, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Farthest reach in windows of about a width; v and u (px) count from the image's corner."""
    cell = 1 if width_px < 3.5 else 2
    cells = min(31, max(1, int(width_px / cell + 0.5)))
    grown = np.pad(reach, [(0, -size % cell) for size in reach.shape])
    parts = [grown[n // cell :: cell, n % cell :: cell] for n in range(cell**2)]
    cut = np.pad(np.max(parts, axis=0), cells)
    windows = np.lib.stride_tricks.sliding_window_view(cut, (cells, cells))
    middle = 0.5 if cells % 2 == 0 else 0.0
    top, left = (np.floor(x / cell + middle).astype(int) + (cells + 1) // 2 for x in (v, u))
    return windows[top, left].max(axis=(-2, -1))


def voxels_seen_beyond(view: View) -> tuple[np.ndarray, np.ndarray]:
    """(nx, ny, nz) whether the image reaches beyond a voxel, and where that is too near to tell."""
    fx, fy, cx, cy = view.pinhole
    (height, width), margin_m = view.depth.shape, MARGIN * BOX.resolution_m
    reach = np.minimum(view.depth, int(view.max_range_m / view.scale_m)) * view.scale_m
    free, unsure = np.zeros(BOX.shape, bool), np.zeros(BOX.shape, bool)
    for brick in np.ndindex(BOX.num_bricks):
        part = tuple(slice(8 * n, 8 * n + 8) for n in brick)
        centres_m = CORNERS_M[part] + BOX.resolution_m / 2
        x, y, z = np.moveaxis(apply(inverse(view.T_map_camera), centres_m), -1, 0)
        # The window is chosen once per brick, by the depth of its centre.
        width_px = FOOTPRINT * fx * BOX.resolution_m / max(z.mean(), 0.02)
        u, v = x * fx / z + cx + 0.5, y * fy / z + cy + 0.5
        says = []
        # As computed first, then with every quantity a little less and a little more.
        for e, f, d in [(0, 0, 0), *itertools.product((-1, 1), repeat=3)]:
            a, b = v + e * NEAR_BORDER, u + f * NEAR_BORDER
            seen = (z > 0.02) & (a >= 0) & (b >= 0) & (a < height) & (b < width)
            far = farthest(reach, width_px * (1 + d * 1e-5), a * seen, b * seen)
            says.append(seen & (z + margin_m + d * NEAR_M < far))
        free[part], unsure[part] = says[0], np.any(says != says[0], axis=0)
    return free, unsure


def blocky_image(rng: np.random.Generator, rows: int) -> np.ndarray:
    """Surfaces of 9x9 pixels, some noise, pixels that know nothing or saw nothing."""
    surfaces = np.kron(rng.integers(200, 1700, (11, 15)), np.ones((9, 9), int))
    image = surfaces[:rows, : rows * 4 // 3] + rng.integers(0, 10, (rows, rows * 4 // 3))
    image[rng.random(image.shape) < 0.1] = 0
    image[: rows // 4][rng.random(image[: rows // 4].shape) < 0.3] = NO_RETURN
    return image.astype(np.uint16)


@pytest.mark.parametrize(
    ("rows", "focal_px", "eye"),  # windows of 1 and 2 pixels, of 3 and more, of cells; in the box.
    [(37, 45, (1, 0.3, 0.6)), (64, 120, (-0.7, 0.4, 0.5)), (91, 260, (0.1, -0.6, 0.7))]
    + [(48, 50, (0.1, 0.05, 0.293))],
)
def test_an_image_hits_and_frees_what_projecting_every_voxel_says(
    rng: np.random.Generator, rows: int, focal_px: float, eye: tuple[float, ...]
) -> None:
    pinhole, T = (focal_px, focal_px * 1.1, rows * 0.7, rows / 2), look_at(eye, (-0.05, 0.02, 0.25))
    view = View(blocky_image(rng, rows), pinhole, T, 0.001, max_range_m=1.5)
    view.depth[voxels_hit(view)[1] & (view.depth != NO_RETURN)] = 0
    store, prior = random_map(rng)
    fused = ProjectiveIntegrator(BOX, store, SENSOR).fuse(view)
    (hit, _), (free, unsure) = voxels_hit(view), voxels_seen_beyond(view)
    assert fused.num_hits == hit.sum() > 50
    assert fused.num_returns == ((view.depth != 0) & (view.depth != NO_RETURN)).sum()
    assert free.mean() > 0.02
    assert_updated(store, prior, hit, free, unsure)


@pytest.mark.parametrize("discretize", [True, False])
@pytest.mark.parametrize(("spread", "max_range_m"), [(0.9, 9.0), (0.9, 0.3), (3.0, 9.0)])
def test_rays_cross_the_voxels_in_which_they_have_a_length(
    rng: np.random.Generator, spread: float, max_range_m: float, discretize: bool
) -> None:
    half = np.array(BOX.shape) * BOX.resolution_m / 2
    points = (LOW_M + half + spread * rng.uniform(-half, half, (60, 3))).astype(np.float32)
    origin = (LOW_M + half + spread * half * (0.9, -0.4, 0.6)).astype(np.float32)
    store, prior = random_map(rng)
    num_hits, _ = ExactIntegrator(BOX, store, SENSOR).fuse(points, origin, max_range_m, discretize)
    hit, free, unsure = (np.zeros(BOX.shape, bool) for _ in range(3))
    for end in points.astype(np.float64):
        if discretize:
            end = (np.floor(end / BOX.resolution_m) + 0.5) * BOX.resolution_m
        range_m = np.linalg.norm(end - origin)
        end = origin + (end - origin) * min(1.0, max_range_m / range_m)
        # Its length within every voxel; below zero where it passes by.
        faces = (np.stack([CORNERS_M, CORNERS_M + BOX.resolution_m]) - origin) / (end - origin)
        enters, leaves = faces.min(axis=0).max(axis=-1), faces.max(axis=0).min(axis=-1)
        length = (np.minimum(leaves, 1) - np.maximum(enters, 0)) * min(range_m, max_range_m)
        key = np.floor(end / BOX.resolution_m).astype(int) - BOX.first_key
        if ((key >= 0) & (key < BOX.shape)).all():
            hit[tuple(key)] |= range_m <= max_range_m
            length[tuple(key)] = -1.0
        free |= length > NEAR_M
        unsure |= np.abs(length) <= NEAR_M
    assert num_hits == hit.sum()
    assert free.sum() > 300
    assert_updated(store, prior, hit, free, unsure & ~free)


def test_changes_are_where_the_classes_differ_from_those_told(rng: np.random.Generator) -> None:
    store, _ = random_map(rng)
    told, told_value = np.full((len(INDEX), VOXELS), 9, np.uint8), np.zeros(len(INDEX), np.uint8)
    before, rows = np.zeros(BOX.shape, int), np.empty((2 * VOXELS, 4), np.int16)
    for _ in range(3):
        now = class_of(expanded(store))
        brick, changes = 0, []
        while brick < len(told):
            brick, count = classes.publish(store.bricks, told, told_value, brick, rows)
            changes += rows[:count].tolist()
        expected = np.column_stack([np.argwhere(now != before), now[now != before]])
        assert sorted(changes) == expected.tolist()
        before = now
        store.restore(INDEX, random_log_odds(rng))


def test_counts_classes_and_entropy_are_those_of_the_dense_map(rng: np.random.Generator) -> None:
    store, dense = random_map(rng)
    np.testing.assert_array_equal(expanded(store), dense)
    known = class_of(dense)
    assert classes.count_classes(store.bricks) == ((known == 1).sum(), (known == 2).sum())
    keys, out = rng.integers(-3, np.array(BOX.shape) + 3, (2000, 3)), np.empty(2000, np.uint8)
    classes.classify_points(store.bricks, keys, out)
    np.testing.assert_array_equal(out, np.pad(known, 3)[tuple((keys + 3).T)])
    table = rng.random(4096).astype(np.float32)
    expected = table[(dense.astype(int) + 32768) // 16].astype(np.float64).sum()
    assert classes.sum_entropy(store.bricks, table, 4) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("factor", "forgotten"), [(0.93, 800), (1.0, 0), (0.02, 800)])
def test_fading_scales_every_voxel_towards_zero_and_forgets_the_nearly_even(
    rng: np.random.Generator, factor: float, forgotten: int
) -> None:
    store, dense = random_map(rng)
    classes.fade_bricks(store.bricks, np.float32(factor), forgotten)
    faded = np.trunc(dense.astype(np.float32) * np.float32(factor))
    faded[(dense == UNKNOWN) | (np.abs(faded) < forgotten)] = UNKNOWN
    np.testing.assert_array_equal(expanded(store), faded)
