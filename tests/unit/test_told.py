"""What is told of classes: the kernels against numpy, and the memory they take."""

import numpy as np
import pytest

from services.kernels import told
from services.kernels.bricks import UNKNOWN, VOXELS
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.published import Published
from services.mapper.sensor_model import SensorModel

pytestmark = pytest.mark.unit

BOX = Box(0.05, (-12, 5, -3), (3, 4, 2))
INDEX = np.argwhere(np.ones(BOX.num_bricks)).astype(np.int16)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def random_log_odds(rng: np.random.Generator) -> np.ndarray:
    """Bricks of every kind: one value, one class, all classes."""
    log_odds = rng.integers(-9000, 9000, (len(INDEX), VOXELS)).astype(np.int16)
    log_odds[rng.random(log_odds.shape) < 0.3] = UNKNOWN
    kind = rng.integers(0, 5, len(INDEX))
    log_odds[kind == 0] = UNKNOWN
    log_odds[kind == 1] = rng.choice([-500, 0, 700])
    log_odds[kind == 2] = rng.integers(-900, -1, (np.count_nonzero(kind == 2), VOXELS))
    return log_odds


def class_of(log_odds: np.ndarray) -> np.ndarray:
    return np.where(log_odds == UNKNOWN, 0, np.where(log_odds >= 0, 2, 1))


def dense(bricks: np.ndarray) -> np.ndarray:
    """Lay (B, 512) out as the box."""
    nx, ny, nz = BOX.num_bricks
    return bricks.reshape(nx, ny, nz, 8, 8, 8).transpose(0, 3, 1, 4, 2, 5).reshape(BOX.shape)


def packed_by_numpy(classes: np.ndarray) -> np.ndarray:
    return (classes.reshape(4, told.BYTES) << np.array([[0], [2], [4], [6]])).sum(axis=0)


def test_packing_puts_four_classes_into_a_byte(rng: np.random.Generator) -> None:
    out = np.empty(told.BYTES, np.uint8)
    for row in random_log_odds(rng):
        told.pack_row(row, out)
        expected = packed_by_numpy(class_of(row))
        np.testing.assert_array_equal(out, expected)
        kinds = np.unique(class_of(row))
        assert told.state_of(out) == (-1 - kinds[0] if len(kinds) == 1 else 0)
        assert told.num_unlike(out, np.full(told.BYTES, 85, np.uint8)) == (expected != 85).sum()


@pytest.mark.parametrize("max_rows", [None, 5 * VOXELS])
def test_changes_are_where_the_classes_differ_from_those_told(
    rng: np.random.Generator, max_rows: int | None
) -> None:
    store = BrickStore(BOX.num_bricks)
    published, before = Published(BOX, store), np.zeros(BOX.shape, int)
    for _ in range(6):
        log_odds = random_log_odds(rng)
        store.restore(INDEX, log_odds)
        now = dense(class_of(log_odds))
        parts = []
        while len(parts) == 0 or len(parts[-1]):
            parts.append(published.changes(BOX, max_rows))
            assert max_rows is None or len(parts[-1]) <= max_rows
        expected = np.column_stack([np.argwhere(now != before), now[now != before]])
        assert sorted(np.concatenate(parts).tolist()) == expected.tolist()
        before = now


def test_what_does_not_fit_comes_first_with_the_next_changes() -> None:
    store = BrickStore(BOX.num_bricks)
    published, mirror = Published(BOX, store), np.zeros(BOX.shape, int)
    log_odds = np.full((len(INDEX), VOXELS), -5, np.int16)
    for _ in range(3):
        log_odds = -log_odds  # Every class flips: a third of the box fits.
        store.restore(INDEX, log_odds)
        rows = published.changes(BOX, len(INDEX) // 3 * VOXELS)
        mirror[tuple(rows[:, :3].T)] = rows[:, 3]
    assert (mirror != 0).all()
    snapshot = published.snapshot(BOX, SensorModel())
    np.testing.assert_array_equal(snapshot.bricks, INDEX)
    np.testing.assert_array_equal(dense(class_of(snapshot.log_odds)), mirror)


@pytest.mark.parametrize("max_rows", [None, 100_000])
def test_changes_of_every_voxel_of_mixed_bricks_are_told(max_rows: int | None) -> None:
    large = Box(0.05, (0, 0, 0), (10, 10, 6))
    store = BrickStore(large.num_bricks)
    published, index = Published(large, store), np.argwhere(np.ones(large.num_bricks))
    log_odds = np.full((len(index), VOXELS), -5, np.int16)
    log_odds[:, ::2] = 5
    for _ in range(2):
        log_odds = -log_odds
        store.restore(index.astype(np.int16), log_odds)
        told_rows = 0
        while count := len(published.changes(large, max_rows)):
            assert max_rows is None or count <= max_rows
            told_rows += count
        assert told_rows == large.num_voxels


def test_only_bricks_of_several_classes_take_memory(rng: np.random.Generator) -> None:
    large = Box(0.05, (0, 0, 0), (40, 40, 10))
    store = BrickStore(large.num_bricks)
    published = Published(large, store)
    empty = published.num_bytes
    index = np.argwhere(np.ones(large.num_bricks)).astype(np.int16)
    one_class = rng.integers(-900, -1, (len(index), VOXELS)).astype(np.int16)
    store.restore(index, one_class)
    assert len(published.changes(large)) == large.num_voxels
    assert published.num_bytes == empty
    several = one_class.copy()
    several[:, 3] = 5
    for log_odds in (several, one_class, several):  # Rows that are given back are used again.
        store.restore(index, log_odds)
        published.changes(large)
    assert published.num_bytes - empty <= len(index) * (told.BYTES + 4)
