"""What comes where it was free for long is dynamic; what noise fills at a surface is not."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from services.kernels import ever_free
from services.kernels.bricks import UNKNOWN
from services.mapper.brick_store import BrickStore
from services.mapper.ever_free import FRAMES, STAY, EverFreeWatch
from services.mapper.sensor_model import SensorModel
from services.mapper.voxel_map import VoxelMap
from tests.ball_scene import EYES, PINHOLE, image, look_at

pytestmark = pytest.mark.unit

LOW = SensorModel().fixed_point()[2]
EVER, DYNAMIC = ever_free.EVER, ever_free.DYNAMIC


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def dense(bricks_of: np.ndarray, shape: tuple[int, int, int]) -> np.ndarray:
    """(B, 512) values as (nx, ny, nz)."""
    blocks = bricks_of.reshape(*shape, 8, 8, 8)
    return blocks.transpose(0, 3, 1, 4, 2, 5).reshape([8 * n for n in shape])


def twin_step(state: np.ndarray, log_odds: np.ndarray, frames: int, stay: int) -> np.ndarray:
    """One instant of every voxel, and the flags, over the whole array."""
    free = (log_odds <= 0.75 * LOW) & (log_odds != UNKNOWN)
    occupied = log_odds >= 0
    longer = np.where(state + 1 >= frames, EVER, state + 1)
    young = np.where(free, longer, np.where(occupied, 0, state))
    since = state % EVER + 1
    old = np.where(occupied, np.where(since > stay, 0, state + 1), EVER)
    now = np.where(state >= EVER, old, young)
    ring = np.ones((3, 3, 3))
    ring[1, 1, 1] = 0
    least = minimum_filter(now, footprint=ring, mode="constant", cval=0)
    now = np.where((now > EVER) & (now < DYNAMIC) & (least >= EVER), now + DYNAMIC, now)
    while True:
        greatest = maximum_filter(now, footprint=ring, mode="constant", cval=0)
        grown = (now > EVER) & (now < DYNAMIC) & (greatest > DYNAMIC)
        if not grown.any():
            return now
        now = np.where(grown, now + DYNAMIC, now)


@pytest.mark.parametrize(("frames", "stay"), [(1, 3), (4, 62), (8, 5)])
def test_states_are_those_of_a_twin_that_asks_every_voxel_at_every_instant(
    rng: np.random.Generator, frames: int, stay: int
) -> None:
    shape = (3, 2, 2)
    index = np.argwhere(np.ones(shape)).astype(np.int16)
    watch = EverFreeWatch(shape, frames, stay)
    twin = np.zeros([8 * n for n in shape], int)
    num_flagged = 0
    for n in range(40):
        log_odds = np.full((len(index), 512), LOW, np.int16)
        if n % 12 > 8:  # Something comes and goes; some of it is noise, some unknown.
            log_odds[rng.random(log_odds.shape) < 0.02] = 3000
            log_odds[rng.integers(len(index))] = rng.choice([3000, UNKNOWN, LOW])
        log_odds[:2, :64] = np.where(rng.random((2, 64)) < 0.9, 9000, UNKNOWN)
        store = BrickStore(shape)
        store.restore(index, log_odds)
        watch.observe(store.bricks, LOW)
        twin = twin_step(twin, dense(log_odds, shape).astype(int), frames, stay)
        flagged = np.argwhere(twin > DYNAMIC)
        assert sorted(map(tuple, watch.dynamic())) == sorted(map(tuple, flagged))
        assert watch.num_dynamic == len(flagged)
        num_flagged += len(flagged)
    assert num_flagged > 100


def test_a_brick_whose_changes_have_yet_to_be_told_is_not_looked_at_again() -> None:
    shape, index = (3, 1, 1), np.argwhere(np.ones((3, 1, 1))).astype(np.int16)
    watch, store = EverFreeWatch(shape, frames=2, stay=3), BrickStore(shape)
    log_odds = np.full((3, 512), LOW, np.int16)
    log_odds[:, 0] = UNKNOWN  # Else a brick surely free is looked at, written or not.
    store.restore(index, log_odds)
    for _ in range(5):
        watch.observe(store.bricks, LOW)
    assert store.bricks.dirty.all()
    assert watch._ever.state[watch._ever.row].max() == 1
    store.bricks.dirty[1] = 1
    watch.observe(store.bricks, LOW)
    assert watch._ever.state[watch._ever.row].max(axis=1).tolist() == [1, EVER, 1]


RESOLUTION_M = 0.04
BOUNDS = ((-0.8, -0.64, 0.0), (0.8, 0.64, 0.64))


def test_a_ball_that_rolls_through_is_flagged_and_the_rest_is_not(
    rng: np.random.Generator,
) -> None:
    voxels = VoxelMap(RESOLUTION_M, *BOUNDS, SensorModel.from_frames(2, 1), dynamic=True)
    rest = (np.array([0.3, 0.3, 0.15]), 0.15)
    found = false = missed = 0
    for n in range(45):
        x = -0.5 + 0.04 * (n - FRAMES) if n >= FRAMES else -9.0
        ball = (np.array([x, -0.1, 0.16]), 0.16)
        for eye in EYES:
            T = look_at(eye)
            depth = image(T, [rest, ball], rng.normal(size=(120, 160)))
            voxels.fuse_depth(depth, PINHOLE, T)
        voxels.changes()
        assert len(voxels.dynamic().centres_m) == voxels.num_dynamic
        flagged, occupied = voxels.dynamic().centres_m, voxels.occupied().centres_m
        near = np.linalg.norm(occupied - ball[0], axis=1) < ball[1] + RESOLUTION_M
        near &= occupied[:, 2] > RESOLUTION_M  # The ground under it was there before.
        is_flagged = np.isin(keys(voxels, occupied), keys(voxels, flagged))
        if n < FRAMES:
            assert not len(flagged)
        else:
            found += int((near & is_flagged).sum())
            false += int((~near & is_flagged).sum())
            missed += int((near & ~is_flagged).sum())
    assert found / (found + false) > 0.95
    assert found / (found + missed) > 0.95


def keys(voxels: VoxelMap, centres_m: np.ndarray) -> np.ndarray:
    at = voxels.box.keys(centres_m)
    return np.ravel_multi_index(tuple(at.T), voxels.box.shape)


def column(voxels: VoxelMap, top_m: float, times: int) -> None:
    """Rays from above that return at a height, over the middle of the box."""
    xs = np.arange(-0.3, 0.31, 0.02)
    ends = np.stack([*np.meshgrid(xs, xs), np.full((len(xs), len(xs)), top_m)], axis=-1)
    for _ in range(times):
        voxels.fuse_points(ends.reshape(-1, 3), (0.0, 0.0, 3.0))
        voxels.changes()


def test_what_has_come_and_stays_becomes_background_and_what_leaves_is_forgotten() -> None:
    voxels = VoxelMap(RESOLUTION_M, *BOUNDS, SensorModel.from_frames(1, 1), dynamic=True)
    column(voxels, 0.02, FRAMES + 1)
    assert voxels.num_dynamic == 0
    column(voxels, 0.42, 1)
    arrived = voxels.num_dynamic
    assert arrived > 50
    column(voxels, 0.02, 1)
    assert voxels.num_dynamic == 0
    column(voxels, 0.42, STAY)
    assert voxels.num_dynamic == arrived
    column(voxels, 0.42, 1)
    assert voxels.num_dynamic == 0
    assert voxels.counts().occupied > arrived


def test_flags_move_with_the_window_and_are_cleared_with_the_map() -> None:
    voxels = VoxelMap(RESOLUTION_M, *BOUNDS, SensorModel.from_frames(1, 1), dynamic=True)
    column(voxels, 0.02, FRAMES + 1)
    column(voxels, 0.42, 1)
    before = voxels.dynamic()
    assert voxels.move_to((0.33, 0.0, 0.32), 0.0)
    after = voxels.dynamic()
    inside = (before.centres_m > voxels.box.origin_m).all(axis=1)
    np.testing.assert_allclose(
        np.unique(after.centres_m, axis=0), np.unique(before.centres_m[inside], axis=0)
    )
    assert len(after.centres_m) > 20
    assert (after.probability >= 0.5).all()
    voxels.clear()
    assert voxels.num_dynamic == 0
    column(voxels, 0.42, 1)
    assert voxels.num_dynamic == 0


def test_what_was_flagged_and_is_occupied_no_more_is_not_listed() -> None:
    voxels = VoxelMap(RESOLUTION_M, *BOUNDS, SensorModel.from_frames(1, 1), dynamic=True)
    column(voxels, 0.02, FRAMES + 1)
    column(voxels, 0.42, 1)
    assert voxels.num_dynamic == len(voxels.dynamic().centres_m) > 20
    voxels.decay(1e6, 1.0)  # Flags are of the last changes, and all is forgotten since.
    assert voxels.num_dynamic == len(voxels.dynamic().centres_m) == 0


def test_nothing_is_held_unless_asked_for() -> None:
    voxels = VoxelMap(RESOLUTION_M, *BOUNDS)
    watched = VoxelMap(RESOLUTION_M, *BOUNDS, dynamic=True)
    assert len(voxels.dynamic().centres_m) == voxels.num_dynamic == 0
    added = watched.num_bytes - voxels.num_bytes
    assert added < 16 * voxels.box.num_voxels / 512
    column(watched, 0.02, FRAMES + 1)
    column(voxels, 0.02, FRAMES + 1)
    assert watched.num_bytes - voxels.num_bytes < added + 2 * voxels.box.num_voxels
