"""Owner of the bricks' memory: a directory of the box, a pool that grows with what is seen."""

import math

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS, Bricks

_FIRST_SLOTS = 64
_LAST_SCAN = 255  # scans are counted in uint8; stamps are wiped when the count wraps.


class BrickStore:
    """The bricks of a box, and the count of scans that stamps refer to."""

    def __init__(self, num_bricks: tuple[int, int, int]) -> None:
        total = math.prod(num_bricks)
        slots = min(_FIRST_SLOTS, total)
        self.scan = np.uint8(0)
        self.bricks = Bricks(
            shape=np.asarray(num_bricks, np.int64),
            slot=np.full(total, UNIFORM, np.int32),
            value=np.full(total, UNKNOWN, np.int16),
            hit_scan=np.zeros(total, np.uint8),
            dirty=np.zeros(total, np.uint8),
            log_odds=np.empty((slots, VOXELS), np.int16),
            stamp=np.zeros((slots, VOXELS), np.uint8),
            free_slots=np.arange(slots, dtype=np.int32)[::-1].copy(),
            num_free=np.array([slots], np.int64),
        )

    def begin_scan(self) -> np.uint8:
        """Return the number of a new scan, which no stamp bears yet."""
        if self.scan == _LAST_SCAN:
            self.bricks.stamp.fill(0)
            self.bricks.hit_scan.fill(0)
            self.scan = np.uint8(0)
        self.scan = np.uint8(self.scan + 1)
        return self.scan

    def grow(self) -> None:
        """Double the pool, at most to one slot per brick."""
        old, total = self.bricks, self.bricks.slot.size
        before, height = len(old.log_odds), int(old.num_free[0])
        after = min(2 * before, total)
        log_odds = np.empty((after, VOXELS), np.int16)
        log_odds[:before] = old.log_odds
        stamp = np.zeros((after, VOXELS), np.uint8)
        stamp[:before] = old.stamp
        free = np.empty(after, np.int32)
        added = np.arange(before, after, dtype=np.int32)[::-1]
        free[: len(added)] = added
        free[len(added) : len(added) + height] = old.free_slots[:height]
        self.bricks = old._replace(log_odds=log_odds, stamp=stamp, free_slots=free)
        self.bricks.num_free[0] = len(added) + height

    def clear(self) -> None:
        """Forget everything: bricks become unknown, their slots are free, the pool is untouched."""
        bricks = self.bricks
        known = (bricks.slot != UNIFORM) | (bricks.value != UNKNOWN)
        bricks.dirty[known] = 1
        bricks.slot.fill(UNIFORM)
        bricks.value.fill(UNKNOWN)
        slots = len(bricks.free_slots)
        bricks.free_slots[:] = np.arange(slots, dtype=np.int32)[::-1]
        bricks.num_free[0] = slots

    @property
    def num_open(self) -> int:
        """Bricks that hold a slot."""
        return len(self.bricks.free_slots) - int(self.bricks.num_free[0])

    @property
    def num_bytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in self.bricks)

    def known(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return (M, 3) indices and (M, 512) log-odds of the bricks that know anything."""
        bricks = self.bricks
        rows = np.flatnonzero((bricks.slot != UNIFORM) | (bricks.value != UNKNOWN))
        log_odds = np.repeat(bricks.value[rows, None], VOXELS, axis=1)
        is_open = bricks.slot[rows] != UNIFORM
        log_odds[is_open] = bricks.log_odds[bricks.slot[rows[is_open]]]
        index = np.stack(np.unravel_index(rows, tuple(bricks.shape)), axis=1)
        return index.astype(np.int16), log_odds

    def restore(self, index: NDArray[np.int16], log_odds: NDArray[np.int16]) -> None:
        """Replace everything by what `known` returned."""
        self.clear()
        uniform = (log_odds == log_odds[:, :1]).all(axis=1)
        while self.num_open + np.count_nonzero(~uniform) > len(self.bricks.free_slots):
            self.grow()
        bricks = self.bricks
        rows = np.ravel_multi_index(tuple(index.astype(np.int64).T), tuple(bricks.shape))
        bricks.dirty[rows] = 1
        bricks.value[rows[uniform]] = log_odds[uniform, 0]
        opened = rows[~uniform]
        height = int(bricks.num_free[0]) - len(opened)
        slots = bricks.free_slots[height : height + len(opened)]
        bricks.slot[opened] = slots
        bricks.log_odds[slots] = log_odds[~uniform]
        bricks.num_free[0] = height
