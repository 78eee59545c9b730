"""Forgetting brick by brick, when it matters, is forgetting every voxel at every step."""

import numpy as np
import pytest

from services.kernels import classes, fade
from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS
from services.kernels.fade import FORGOTTEN
from services.kernels.rigid import look_at
from services.mapper.brick_store import BrickStore
from services.mapper.sensor_model import LOG_ODDS_SCALE
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

SHAPE = (4, 3, 2)
INDEX = np.argwhere(np.ones(SHAPE)).astype(np.int16)
PINHOLE = (60.0, 60.0, 29.5, 21.5)
HALF_LIFE_S = 1.0


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def random_store(rng: np.random.Generator) -> tuple[BrickStore, np.ndarray]:
    """A store of unknown, uniform and mixed bricks, and their (B, 512) log-odds."""
    mixed = rng.integers(-16384, 28763, (len(INDEX), VOXELS))
    mixed[rng.random(mixed.shape) < 0.3] = UNKNOWN
    uniform = rng.integers(-16384, 28763, (len(INDEX), 1))
    kind = rng.integers(0, 3, (len(INDEX), 1))
    log_odds = np.choose(kind, [UNKNOWN, uniform, mixed]).astype(np.int16)
    store = BrickStore(SHAPE)
    store.restore(INDEX, log_odds)
    fade.begin(store.bricks, HALF_LIFE_S)
    return store, log_odds


def faded(log_odds: np.ndarray, factor: float) -> np.ndarray:
    """Every voxel scaled, in double precision; NaN is unknown."""
    scaled = np.where(log_odds == UNKNOWN, np.nan, log_odds * factor)
    return np.where(np.abs(scaled) < FORGOTTEN, np.nan, scaled)


def held(store: BrickStore) -> np.ndarray:
    """(B, 512) log-odds as they are stored; NaN is unknown."""
    rows, log_odds = store.known()
    out = np.full((len(INDEX), VOXELS), np.nan)
    out[np.ravel_multi_index(tuple(rows.astype(int).T), SHAPE)] = np.where(
        log_odds == UNKNOWN, np.nan, log_odds
    )
    return out


def classes_of(log_odds: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(log_odds), 0, np.where(log_odds >= 0, 2, 1))


@pytest.mark.parametrize("dt_s", [0.01, 0.3, 1.0, 2.5, 6.0])
def test_fading_scales_every_voxel_towards_zero_and_forgets_the_nearly_even(
    rng: np.random.Generator, dt_s: float
) -> None:
    store, log_odds = random_store(rng)
    store.bricks.clock[0] += dt_s
    fade.fade_all(store.bricks)
    np.testing.assert_allclose(held(store), faded(log_odds, 0.5**dt_s), atol=0.51)


def test_settling_makes_classes_those_of_now_and_writes_no_brick_whose_classes_stay(
    rng: np.random.Generator,
) -> None:
    store, log_odds = random_store(rng)
    bricks, before_t_s = store.bricks, 0.0
    for t_s in np.cumsum(rng.uniform(0.01, 0.4, 40)):
        before = held(store)
        bricks.clock[0] = t_s
        fade.settle(bricks)
        expected = faded(log_odds, 0.5**t_s)
        unsure = np.abs(np.abs(log_odds * 0.5**t_s) - FORGOTTEN) < 1.0
        np.testing.assert_array_equal(
            classes_of(held(store))[~unsure], classes_of(expected)[~unsure]
        )
        # The first time every brick is looked at: what was written may be weak.
        changed = (classes_of(held(store)) != classes_of(before)).any(axis=1)
        written = (held(store) != np.nan_to_num(before, nan=9e9)) & ~np.isnan(held(store))
        if before_t_s > 0.0:
            assert not written.any(axis=1)[~changed].any()
        before_t_s = t_s
    assert np.isnan(held(store)).all()
    assert store.num_open == 0


def test_a_brick_is_faded_when_it_was_written_or_expires_and_not_at_every_step(
    rng: np.random.Generator,
) -> None:
    store, log_odds = random_store(rng)
    bricks = store.bricks
    bricks.clock[0] += 0.1
    known = np.flatnonzero((log_odds != UNKNOWN).any(axis=1))
    assert fade.settle(bricks) == len(known)  # The half-life is new.
    assert fade.settle(bricks) == 0
    strong = np.flatnonzero(bricks.expiry == bricks.expiry[known].max())[:1]
    bricks.clock[0] = np.min(bricks.expiry)
    assert fade.settle(bricks) == 0
    bricks.clock[0] += 1e-6
    assert fade.settle(bricks) == 1
    fade.refresh(bricks, strong[0])
    assert fade.settle(bricks) == 0
    bricks.clock[0] += 1e-6
    assert fade.settle(bricks) == 1


def test_only_bricks_whose_classes_change_are_told_again(rng: np.random.Generator) -> None:
    store, _ = random_store(rng)
    bricks = store.bricks
    for _ in range(30):
        bricks.dirty.fill(0)
        before = classes_of(held(store))
        bricks.clock[0] += 0.1
        fade.settle(bricks)
        changed = (classes_of(held(store)) != before).any(axis=1)
        np.testing.assert_array_equal(bricks.dirty == 1, changed)


def test_a_brick_written_at_every_tiny_step_still_fades(rng: np.random.Generator) -> None:
    store, log_odds = random_store(rng)
    brick = int(np.flatnonzero(store.bricks.slot != UNIFORM)[0])
    for _ in range(2000):
        store.bricks.clock[0] += 0.0005
        fade.refresh(store.bricks, brick)
    sure = np.abs(log_odds[brick].astype(float)) > 2.1 * FORGOTTEN
    sure &= log_odds[brick] != UNKNOWN
    np.testing.assert_allclose(held(store)[brick][sure], log_odds[brick][sure] * 0.5, rtol=0.02)


def test_while_nothing_fades_a_refresh_touches_nothing(rng: np.random.Generator) -> None:
    store, _ = random_store(rng)
    fade.begin(store.bricks, np.inf)
    before = [array.copy() for array in store.bricks]
    for brick in range(len(INDEX)):
        fade.refresh(store.bricks, brick)
    assert fade.settle(store.bricks) == fade.fade_all(store.bricks) == 0
    for now, then in zip(store.bricks, before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_a_brick_at_the_lower_clamp_is_left_alone_until_it_has_faded() -> None:
    store = BrickStore(SHAPE)
    store.restore(INDEX[:1], np.full((1, VOXELS), -16384, np.int16))
    fade.begin(store.bricks, HALF_LIFE_S)
    assert fade.is_lowest(store.bricks, 0, -16384)
    assert not fade.is_lowest(store.bricks, 1, -16384)
    store.bricks.clock[0] += 0.1
    assert not fade.is_lowest(store.bricks, 0, -16384)


LOW_M, HIGH_M = (-0.4, -0.4, 0.0), (0.4, 0.4, 0.48)


def random_scan(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A depth image of blocks, from a random side."""
    image = np.kron(rng.integers(300, 1400, (6, 8)), np.ones((8, 8), int)).astype(np.uint16)
    image[rng.random(image.shape) < 0.05] = 0
    return image, look_at((*rng.uniform(-0.9, 0.9, 2), 0.8), (*rng.uniform(-0.2, 0.2, 2), 0.2))


def dense_classes(voxels: VoxelMap) -> np.ndarray:
    centres = voxels.box.centres_m(np.argwhere(np.ones(voxels.box.shape)))
    return voxels.classify(centres).reshape(voxels.box.shape)


@pytest.mark.parametrize("dt_s", [0.05, 0.4])
@pytest.mark.parametrize("exact", [False, True])
def test_fusing_forgetting_and_asking_in_any_order_are_as_if_every_voxel_faded_at_every_step(
    rng: np.random.Generator, dt_s: float, exact: bool
) -> None:
    voxels = VoxelMap(0.02, LOW_M, HIGH_M)
    hit, miss, low, high = voxels.sensor.fixed_point()
    truth = np.full(voxels.box.shape, np.nan)
    mirror = np.zeros(voxels.box.shape, int)
    num_forgotten = 0
    for _ in range(60):
        match rng.choice(
            ["fuse", "decay", "changes", "counts", "log-odds"], p=[0.3, 0.4] + [0.1] * 3
        ):
            case "fuse":
                image, T = random_scan(rng)
                once = VoxelMap(0.02, LOW_M, HIGH_M)
                for m in (voxels, once):
                    if exact:
                        points = np.random.default_rng(image.sum()).uniform(LOW_M, HIGH_M, (40, 3))
                        m.fuse_points(points, T[:3, 3])
                    else:
                        m.fuse_depth(image, PINHOLE, T)
                told = dense_classes(once)
                updated = np.clip(np.nan_to_num(truth) + np.choose(told, [0, miss, hit]), low, high)
                truth = np.where(told > 0, updated, truth)
            case "decay":
                voxels.decay(dt_s, 0.4)
                num_forgotten -= np.isnan(truth).sum()
                truth = truth * 0.5 ** (dt_s / 0.4)
                truth[np.abs(truth) < FORGOTTEN] = np.nan
                num_forgotten += np.isnan(truth).sum()
            case "changes":
                changes = voxels.changes()
                assert (mirror[tuple(changes[:, :3].T)] != changes[:, 3]).all()
                mirror[tuple(changes[:, :3].T)] = changes[:, 3]
                np.testing.assert_array_equal(mirror, dense_classes(voxels))
            case "counts":
                known = dense_classes(voxels)
                assert voxels.counts() == tuple((known == c).sum() for c in range(3))
            case "log-odds":
                now = voxels.log_odds_dense() * LOG_ODDS_SCALE
                both = ~np.isnan(now) & ~np.isnan(truth)
                np.testing.assert_allclose(now[both], truth[both], atol=ROUNDING)
        size = np.abs(np.nan_to_num(truth))
        sure = (size > ROUNDING) & (np.abs(size - FORGOTTEN) > ROUNDING) | np.isnan(truth)
        differs = dense_classes(voxels) != classes_of(truth)
        assert not (differs & sure).any()
    assert num_forgotten > 200


ROUNDING = 8.0
"""1/8192: half a unit whenever a brick fades, which fade with it."""


def test_time_passes_at_no_cost_per_brick(rng: np.random.Generator) -> None:
    large = VoxelMap(0.02, (-8, -8, -1), (8, 8, 1))
    large.decay(0.1, HALF_LIFE_S)
    for _ in range(5):
        image, T = random_scan(rng)
        large.fuse_depth(image, PINHOLE, T)
    bricks = large._store.bricks
    assert bricks.slot.size > 100_000
    known = int(((bricks.slot != UNIFORM) | (bricks.value != UNKNOWN)).sum())
    large.decay(0.1, HALF_LIFE_S)
    assert 0 < fade.settle(bricks) <= known
    for _ in range(5):
        large.decay(0.001, HALF_LIFE_S)
        assert fade.settle(bricks) < known / 10


@pytest.mark.parametrize("read", [fade.fade_all, fade.settle])
def test_reading_at_every_tiny_step_forgets_no_later_than_not_reading(
    rng: np.random.Generator, read
) -> None:
    store, log_odds = random_store(rng)
    bricks, step_s = store.bricks, HALF_LIFE_S / 1800  # 30 Hz, half-life 60 s.
    written = int(np.flatnonzero(bricks.slot != UNIFORM)[0])
    for n in range(1, 10_001):
        bricks.clock[0] = n * step_s
        fade.refresh(bricks, written)
        read(bricks)
        if n % 500 == 0:
            unread = log_odds * 0.5 ** (n * step_s)
            sure = np.abs(np.abs(unread) / FORGOTTEN - 1.0) > 0.03
            expected = classes_of(faded(log_odds, 0.5 ** (n * step_s)))
            np.testing.assert_array_equal(classes_of(held(store))[sure], expected[sure])
    assert np.isnan(held(store)).all()


def test_another_half_life_at_every_step_keeps_the_pace(rng: np.random.Generator) -> None:
    voxels, point = VoxelMap(0.02, LOW_M, HIGH_M), (0.01, 0.01, 0.21)
    voxels.fuse_points([point], (0.01, 0.01, 0.45))
    hit = voxels.sensor.fixed_point()[0]
    for half_life_s in rng.uniform(50.0, 70.0, 10_000):
        voxels.decay(half_life_s / 10_000, half_life_s)
    key = tuple(voxels.box.keys(np.array([point]))[0])
    now = voxels.log_odds_dense()[key] * LOG_ODDS_SCALE
    assert now == pytest.approx(hit * 0.5, rel=0.02)


def test_another_half_life_counts_from_when_it_is_told() -> None:
    voxels, point = VoxelMap(0.02, LOW_M, HIGH_M), (0.01, 0.01, 0.21)
    voxels.fuse_points([point], (0.01, 0.01, 0.45))
    hit = voxels.sensor.fixed_point()[0]
    key = tuple(voxels.box.keys(np.array([point]))[0])
    for dt_s, half_life_s in ((1.0, 2.0), (0.5, 1.0), (3.0, np.inf), (0.5, 1.0)):
        voxels.decay(dt_s, half_life_s)
    expected = hit * 0.5 ** (1.0 / 2.0 + 0.5 + 0.5) / LOG_ODDS_SCALE
    assert voxels.log_odds_dense()[key] == pytest.approx(expected, abs=3 / LOG_ODDS_SCALE)
    assert classes.class_of(np.int16(hit)) == voxels.classify([point])[0]
