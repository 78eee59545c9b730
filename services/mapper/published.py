"""The classes that the world has been told, so that only what differs is told again."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels import told
from services.kernels.bricks import BRICK, UNKNOWN, VOXELS
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.sensor_model import SensorModel
from services.mapper.shift import Step, leaving, shifted

_FIRST_ROWS = 64
_FIRST_CHANGES = 128 * VOXELS
_NO_LIMIT = 1 << 40
_BRICKS_AT_ONCE = 4096
_ALL_UNKNOWN = -1


class Snapshot(NamedTuple):
    """The map as it was last told."""

    box: Box
    bricks: NDArray[np.int16]
    """(M, 3) indices in that box."""
    log_odds: NDArray[np.int16]
    """(M, 512) in 1/8192; -32768 is unknown."""


class Published:
    """Told classes of a store's voxels; at first everything is unknown.

    The store's window may move at any time: what was told of it is moved along when the next
    changes are told, so that a window that goes and comes back in between has not moved.
    """

    def __init__(self, box: Box, store: BrickStore) -> None:
        self._box, self._store = box, store
        num_bricks = store.bricks.slot.size
        rows = min(_FIRST_ROWS, num_bricks)
        self._told = told.Told(
            state=np.full(num_bricks, _ALL_UNKNOWN, np.int32),
            packed=np.empty((rows, told.BYTES), np.uint8),
            free_rows=np.arange(rows, dtype=np.int32)[::-1].copy(),
            num_free=np.array([rows], np.int64),
        )
        self._rows = np.empty((_FIRST_CHANGES, 4), np.int16)
        self._next = 0
        """The brick to begin with: the first that did not fit the last changes."""

    def changes(self, box: Box, max_rows: int | None = None) -> NDArray[np.int16]:
        """Tell: return (N, 4) rows i, j, k, class, in `box`, that differ from what was told.

        Args:
            box: the store's window, now.
            max_rows: tell no more than these; the rest comes first with the next changes.
        """
        self._follow(box)
        most = _NO_LIMIT if max_rows is None else max_rows
        rows, total, num_bricks = self._rows[:most], 0, len(self._told.state)
        # From where the last changes ended to the end, then from the start.
        for brick in (self._next, 0) if self._next else (0,):
            while brick < num_bricks:
                brick, count = told.tell(self._store.bricks, self._told, brick, rows[total:])
                total += count
                if self._told.num_free[0] == 0 and len(self._told.packed) < num_bricks:
                    self._grow()
                elif brick < num_bricks and len(rows) == most:
                    self._next = brick
                    return self._taken(rows, total)
                elif brick < num_bricks:
                    # Large arrays are mapped and unmapped: none of this stays with the process.
                    longer = np.empty((min(4 * len(rows), most), 4), np.int16)
                    longer[:total] = rows[:total]
                    rows = longer
        self._next = 0
        return self._taken(rows, total)

    def snapshot(self, box: Box, sensor: SensorModel) -> Snapshot:
        """Return the bricks told as known, in the window of the last changes.

        Log-odds are those of now; a voxel that has changed its class since, or has left the window
        `box`, is given those of one hit or one miss.
        """
        rows = np.flatnonzero(self._told.state != _ALL_UNKNOWN)
        index = np.stack(np.unravel_index(rows, self._store.shape), axis=1)
        here = index - _step(self._box, box)
        hit, miss, _, _ = sensor.fixed_point()
        once = np.array([UNKNOWN, miss, hit], np.int16)
        log_odds = np.empty((len(rows), VOXELS), np.int16)
        for first in range(0, len(rows), _BRICKS_AT_ONCE):
            some = slice(first, first + _BRICKS_AT_ONCE)
            now, was = self._now(here[some]), self._classes(rows[some])
            is_class = np.where(now == UNKNOWN, 0, np.where(now >= 0, 2, 1))
            log_odds[some] = np.where(is_class == was, now, once[was])
        return Snapshot(self._box, index.astype(np.int16), log_odds)

    @property
    def num_bytes(self) -> int:
        """Bytes of all arrays."""
        return self._rows.nbytes + sum(array.nbytes for array in self._told)

    def _now(self, index: NDArray[np.int64]) -> NDArray[np.int16]:
        """Return (M, 512) log-odds of bricks (M, 3); unknown where they are not in the window."""
        now = np.full((len(index), VOXELS), UNKNOWN, np.int16)
        inside = ((index >= 0) & (index < self._store.shape)).all(axis=1)
        rows = np.ravel_multi_index(tuple(index[inside].T), self._store.shape)
        now[inside] = self._store.log_odds(rows)
        return now

    def _taken(self, rows: NDArray[np.int16], total: int) -> NDArray[np.int16]:
        return rows[:total].copy() if rows.base is self._rows else rows[:total]

    def _classes(self, rows: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return (M, 512) classes told of the bricks at `rows` (M,)."""
        state = self._told.state[rows]
        uniform = np.where(state < 0, (-1 - state) * told.SPREAD, 0).astype(np.uint8)
        packed = np.where(
            (state < 0)[:, None], uniform[:, None], self._told.packed[np.maximum(state, 0)]
        )
        shifts = np.arange(0, 8, 2, dtype=np.uint8)[:, None]
        classes: NDArray[np.uint8] = (packed[:, None, :] >> shifts & 3).astype(np.uint8)
        return classes.reshape(-1, VOXELS)

    def _follow(self, box: Box) -> None:
        """Move what was told into the window `box`; of what has entered nothing was told."""
        step = _step(self._box, box)
        self._box = box
        if step == (0, 0, 0):
            return
        this, shape = self._told, self._store.shape
        rows = this.state[leaving(shape, step)]
        rows, height = rows[rows >= 0], int(this.num_free[0])
        this.free_rows[height : height + len(rows)] = rows
        this.num_free[0] = height + len(rows)
        state = shifted(this.state, shape, step, _ALL_UNKNOWN)
        self._told, self._next = this._replace(state=state), 0

    def _grow(self) -> None:
        """Double the rows, at most to one per brick."""
        old, total = self._told, len(self._told.state)
        before = len(old.packed)
        after = min(2 * before, total)
        packed = np.empty((after, told.BYTES), np.uint8)
        packed[:before] = old.packed
        added, height = after - before, int(old.num_free[0])
        free_rows = np.empty(after, np.int32)
        free_rows[:added] = np.arange(before, after, dtype=np.int32)[::-1]
        free_rows[added : added + height] = old.free_rows[:height]
        self._told = old._replace(packed=packed, free_rows=free_rows)
        self._told.num_free[0] = added + height


def _step(before: Box, after: Box) -> Step:
    x, y, z = ((b - a) // BRICK for a, b in zip(before.first_key, after.first_key, strict=True))
    return x, y, z
