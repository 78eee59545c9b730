"""The map of a recording at any time: the classes that were told, whatever the way they were."""

import numpy as np
import pytest

from schemas.map import MapChanges, MapFull
from schemas.message import Envelope
from services.recorder.map_state import MapState
from services.runtime.map_mirror import MapMirror
from tests.integration.recording_world import a_map, some_changes

pytestmark = pytest.mark.unit


def envelope(boot: str = "b") -> Envelope:
    return Envelope(seq=0, src="mapper", boot=boot, t_pub_ns=1)


def dense(message: MapFull) -> np.ndarray:
    """Log-odds of all voxels of a box of 24."""
    grid = np.full((24, 24, 24), -32768, np.int16)
    for brick, log_odds in zip(message.bricks * 8, message.log_odds, strict=True):
        i, j, k = brick
        grid[i : i + 8, j : j + 8, k : k + 8] = log_odds
    return grid


def classes(message: MapFull) -> np.ndarray:
    grid = dense(message)
    return np.where(grid == -32768, 0, np.where(grid >= 0, 2, 1))


def applied(grid: np.ndarray, changes: MapChanges) -> np.ndarray:
    grid = grid.copy()
    grid[tuple(changes.voxels.T)] = changes.classes
    return grid


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(8)


def test_a_snapshot_and_changes_give_the_classes_of_a_dense_grid(rng) -> None:
    state, full = MapState(), a_map(rng, rev=3)
    state.take(full, envelope())
    np.testing.assert_array_equal(dense(state.full()), dense(full))
    grid = classes(full)
    for rev in range(4, 30):
        changes = some_changes(rng, rev, rev - 1)
        state.take(changes, envelope())
        grid = applied(grid, changes)
        np.testing.assert_array_equal(classes(state.full()), grid)
        assert state.rev == state.full().rev == rev


def test_changes_from_the_empty_map_need_no_snapshot(rng) -> None:
    state, grid = MapState(), np.zeros((24, 24, 24), int)
    for rev in range(1, 10):
        changes = some_changes(rng, rev, rev - 1)
        state.take(changes, envelope())
        grid = applied(grid, changes)
    np.testing.assert_array_equal(classes(state.full()), grid)


def test_told_anew_it_gives_a_mirror_the_same_voxels(rng) -> None:
    state, full = MapState(), a_map(rng, rev=3)
    state.take(full, envelope())
    state.take(some_changes(rng, 4, 3), envelope())
    by_changes, by_snapshot = MapMirror(), MapMirror()
    by_changes.apply(state.anew())
    by_snapshot.reset(state.full())
    np.testing.assert_array_equal(by_changes.voxels, by_snapshot.voxels)
    assert by_changes.rev == by_snapshot.rev == 4
    again = MapState()
    again.take(state.anew(), envelope())
    np.testing.assert_array_equal(classes(again.full()), classes(state.full()))


def test_after_a_gap_nothing_is_known_until_the_next_snapshot(rng) -> None:
    state = MapState()
    state.take(a_map(rng, rev=3), envelope())
    state.take(some_changes(rng, 6, 5), envelope())
    assert state.full() is None
    assert state.anew() is None
    state.take(full := a_map(rng, rev=5), envelope())
    changed = state.full()
    assert changed.rev == 6  # The changes that were too early have found their base.
    assert (classes(changed) != classes(full)).any()


def test_another_mapper_begins_anew(rng) -> None:
    state = MapState()
    state.take(a_map(rng, rev=30), envelope())
    state.take(some_changes(rng, 1, 0), envelope("c"))
    assert state.rev == 1


def test_a_box_that_moved_takes_its_bricks_along(rng) -> None:
    state, full = MapState(), a_map(rng, rev=3)
    state.take(full, envelope())
    changes = some_changes(rng, 4, 3, num=1)
    x, y, z = full.origin
    moved = changes.model_copy(update={"origin": (x + 8 * full.resolution_m, y, z)})
    state.take(moved, envelope())
    before, after = classes(full), classes(state.full())
    expected = np.zeros_like(before)
    expected[:16] = before[8:]
    np.testing.assert_array_equal(after, applied(expected, moved))


def test_a_box_that_moved_by_a_part_of_a_brick_is_not_guessed_at(rng) -> None:
    state, full = MapState(), a_map(rng, rev=3)
    state.take(full, envelope())
    x, y, z = full.origin
    changes = some_changes(rng, 4, 3)
    state.take(changes.model_copy(update={"origin": (x + 3 * full.resolution_m, y, z)}), envelope())
    assert not state.known
