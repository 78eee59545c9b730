"""Every kernel of the mapper does what its slow and obvious numpy twin does.

Twins of projections and rays are written in double precision; a voxel whose answer would change
within the kernel's single precision is left out, and there must be few of them.
"""

import itertools

import numpy as np
import pytest

from services.kernels import bricks, classes, hits, levels, marks
from services.kernels.bricks import UNKNOWN, VOXELS
from services.kernels.rigid import apply, inverse, look_at
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.exact import ExactIntegrator
from services.mapper.look import FOOTPRINT, MARGIN
from services.mapper.projective import ProjectiveIntegrator
from services.mapper.sensor_model import SensorModel
from services.mapper.view import NO_RETURN, View

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


def bits_of(chosen: np.ndarray) -> np.ndarray:
    """(8,) uint64 marks of (512,) 0 or 1."""
    return np.packbits(chosen.astype(np.uint8), bitorder="little").view(np.uint64)


def test_updates_of_one_voxel_and_of_rows_add_and_clamp(rng: np.random.Generator) -> None:
    for row in random_log_odds(rng)[:30]:
        free, hit = rng.integers(0, 2, (2, VOXELS)).astype(np.int32)
        np.testing.assert_array_equal([bricks.add(x, HIT, LOW, HIGH) for x in row], added(row, HIT))
        all_missed, some_missed, some_hit, spared = row.copy(), row.copy(), row.copy(), free.copy()
        assert bricks.miss_row(all_missed, MISS, LOW) == (added(row, MISS) != LOW).sum()
        np.testing.assert_array_equal(all_missed, added(row, MISS))
        marks.spare(spared, bits_of(hit))
        expected = np.where((free == 1) & (hit == 0), added(row, MISS), row)
        assert marks.miss_some(some_missed, spared, MISS, LOW) == (expected != LOW).sum()
        np.testing.assert_array_equal(some_missed, expected)
        marks.hit_some(some_hit, hit, HIT, LOW, HIGH)
        np.testing.assert_array_equal(some_hit, np.where(hit == 1, added(row, HIT), row))


def test_marks_are_bits_in_the_order_of_voxels(rng: np.random.Generator) -> None:
    for chosen in rng.integers(0, 2, (20, VOXELS)).astype(np.int32):
        out = np.empty(VOXELS, np.int32)
        assert marks.expand(bits_of(chosen), out) == chosen.sum()
        np.testing.assert_array_equal(out, chosen)


def test_merged_marks_are_those_of_both_and_the_other_is_wiped(rng: np.random.Generator) -> None:
    one, other = rng.integers(0, 1 << 62, (2, 64)).astype(np.uint64)
    both = one | other
    marks.merge(one, other)
    np.testing.assert_array_equal(one, both)
    assert not other.any()


def test_marked_voxels_are_taken_in_once_and_a_hit_beats_a_miss(rng: np.random.Generator) -> None:
    store, prior = random_map(rng)
    total = store.bricks.slot.size
    hit, free = rng.random((2, total, VOXELS)) < rng.choice([0, 0.1, 1], (2, total, 1))
    hit_marks, free_marks = (np.stack([bits_of(row) for row in x]).reshape(-1) for x in (hit, free))
    marks.take_in(store.bricks, hit_marks, free_marks, SENSOR.fixed_point())
    assert not hit_marks.any()
    assert not free_marks.any()
    nx, ny, nz = BOX.num_bricks
    hit, free = (
        x.reshape(nx, ny, nz, 8, 8, 8).transpose(0, 3, 1, 4, 2, 5).reshape(BOX.shape)
        for x in (hit, free)
    )
    assert_updated(store, prior, hit, free, np.zeros(BOX.shape, bool))


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


def farthest(reach: np.ndarray, size: tuple[int, int], v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Farthest reach in windows of (rows, columns) from cells v, u on; 0 outside."""
    pad = 60
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(reach, pad), size)
    v, u = (np.clip(x + pad, 0, n - 1) for x, n in zip((v, u), windows.shape, strict=False))
    return windows[v, u].max(axis=(-2, -1))


def halved(reach: np.ndarray) -> np.ndarray:
    """The farthest of each 2x2 pixels."""
    grown = np.pad(reach, [(0, -size % 2) for size in reach.shape])
    return np.max([grown[n // 2 :: 2, n % 2 :: 2] for n in range(4)], axis=0)


def seen_reach(
    reach: np.ndarray, mean_px: float, aspect: float, silhouette_px: np.ndarray, vu: np.ndarray
) -> np.ndarray:
    """How far the image sees around points vu (2, ..), pixels from the first one's centre.

    Args:
        mean_px: mean side of a brick's silhouettes, aspect: width over height, square root.
        silhouette_px: (2, ..) rows and columns of every voxel's own.
    """
    if mean_px < 2.0:
        first = np.floor(vu - silhouette_px / 2).astype(int) + 1
        count = np.minimum(np.floor(vu + silhouette_px / 2).astype(int) - first, 1) + 1
        best = np.zeros(vu.shape[1:])
        for size in itertools.product((1, 2), repeat=2):
            mine = (count == np.reshape(size, (2, *[1] * (vu.ndim - 1)))).all(axis=0)
            best = np.where(mine, farthest(reach, size, *first), best)
        return best
    fine = mean_px < 5.5
    sides = np.arange(2, 6) if fine else levels.WIDTHS
    cell = 1 if fine else 2
    side = int(min(sides, key=lambda s: (abs(s * cell - mean_px), s)))
    widest = levels.WIDEST_PX if fine else levels.WIDTHS[-1]
    rows, columns = (
        int(np.clip(np.round(side * f - (0.2 if f < 1 else 0.0)), 1, widest))
        for f in (1 / aspect, aspect)
    )
    at = [
        np.floor((x + 0.5) / cell + (0.5 if n % 2 == 0 else 0.0)).astype(int) - n // 2
        for x, n in zip(vu, (rows, columns), strict=True)
    ]
    return farthest(reach if fine else halved(reach), (rows, columns), *at)


def voxels_seen_beyond(view: View) -> tuple[np.ndarray, np.ndarray]:
    """(nx, ny, nz) whether the image reaches beyond a voxel, and where that is too near to tell."""
    fx, fy, cx, cy = view.pinhole
    margin_m = MARGIN * BOX.resolution_m
    T_camera_map = inverse(view.T_map_camera)
    along_u, along_v, area = np.abs(T_camera_map[:3, :3]).sum(axis=1)
    wide, side_m = np.sqrt(along_u / along_v), FOOTPRINT * np.sqrt(area) * BOX.resolution_m
    reach = np.minimum(view.depth, int(view.max_range_m / view.scale_m)) * view.scale_m
    free, unsure = np.zeros(BOX.shape, bool), np.zeros(BOX.shape, bool)
    for brick in np.ndindex(BOX.num_bricks):
        part = tuple(slice(8 * n, 8 * n + 8) for n in brick)
        centres_m = CORNERS_M[part] + BOX.resolution_m / 2
        x, y, z = np.moveaxis(apply(T_camera_map, centres_m), -1, 0)
        ahead = z > 0.02
        z = np.where(ahead, z, 1.0)
        # The window is chosen once per brick, by the depth of its centre.
        mean_px = (
            side_m * np.sqrt(fx * fy) / max(apply(T_camera_map, centres_m)[..., 2].mean(), 0.02)
        )
        vu = np.stack([y * fy / z + cy, x * fx / z + cx])
        own_px = np.stack([side_m / wide * fy / z, side_m * wide * fx / z])
        says = []
        # As computed first, then with every quantity a little less and a little more.
        for e, f, d in [(0, 0, 0), *itertools.product((-1, 1), repeat=3)]:
            near = vu + np.reshape((e, f), (2, 1, 1, 1)) * NEAR_BORDER
            grown = 1 + d * 1e-5
            far = seen_reach(reach, mean_px * grown, wide * np.sqrt(fx / fy), own_px * grown, near)
            says.append(ahead & (z + margin_m + d * NEAR_M < far))
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
    fused = ProjectiveIntegrator(BOX, store, SENSOR).fuse([view])
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
