"""Owner of the bricks' memory: a directory of the window, and a pool used as far as is seen."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS, Bricks
from services.mapper.errors import MapTooLarge
from services.mapper.shift import Step, leaving, shifted

_ENTERS = {
    "slot": UNIFORM,
    "value": UNKNOWN,
    "dirty": 1,  # Whoever was told of a brick that left and came back has to be told again.
    "faded": 0.0,
    "expiry": np.inf,
}
"""The directories, and what they hold of a brick that enters the window."""


class BrickStore:
    """The bricks of a box."""

    def __init__(self, num_bricks: tuple[int, int, int]) -> None:
        total = math.prod(num_bricks)
        try:
            # Address space for all: memory comes with the first write to a slot, nothing is moved.
            log_odds = np.empty((total, VOXELS), np.int16)
        except MemoryError:
            raise MapTooLarge(
                f"{total} bricks of {VOXELS} voxels ask for {total >> 20} GiB of address space, "
                "more than this machine grants; choose larger voxels or a smaller box"
            ) from None
        self.bricks = Bricks(
            shape=np.asarray(num_bricks, np.int64),
            slot=np.full(total, UNIFORM, np.int32),
            value=np.full(total, UNKNOWN, np.int16),
            dirty=np.zeros(total, np.uint8),
            log_odds=log_odds,
            free_slots=np.arange(total, dtype=np.int32)[::-1].copy(),
            num_free=np.array([total, total], np.int64),
            clock=np.array([0.0, np.inf]),
            # Read only while something fades, and set when that begins.
            faded=np.zeros(total),
            expiry=np.zeros(total),
        )

    def shares(self, num_slots: Sequence[int]) -> list[Bricks]:
        """Deal out unused slots: the same bricks, to be written span by span at the same time."""
        dealt, stack, num_free = [], self.bricks.free_slots, self.bricks.num_free
        for count in num_slots:
            mine = np.empty_like(stack)
            mine[:count] = stack[num_free[0] - count : num_free[0]]
            num_free[0] -= count
            held = np.array([count, count], np.int64)
            dealt.append(self.bricks._replace(free_slots=mine, num_free=held))
        num_free[1] = min(num_free[1], num_free[0])
        return dealt

    def rejoin(self, shares: Sequence[Bricks]) -> None:
        """Take back the unused slots of `shares`."""
        for share in shares:
            self._free(share.free_slots[: share.num_free[0]])

    def recount(self) -> None:
        """Find the unused slots anew, after a step that did not come to its end."""
        bricks = self.bricks
        used = bricks.slot[bricks.slot != UNIFORM]
        unused = np.setdiff1d(np.arange(len(bricks.free_slots), dtype=np.int32), used)[::-1]
        bricks.free_slots[: len(unused)] = unused
        bricks.num_free[0] = len(unused)

    def clear(self) -> None:
        """Forget everything: bricks become unknown, their slots are free, the pool is untouched."""
        bricks = self.bricks
        bricks.dirty[known_rows(bricks)] = 1
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
        """Bytes of the directory and of the slots that were ever used."""
        directory = sum(array.nbytes for array in self.bricks) - self.bricks.log_odds.nbytes
        return directory + num_touched(self.bricks) * self.bricks.log_odds[:1].nbytes

    def shift(self, step: Step) -> None:
        """Move the window by bricks: what leaves it is forgotten, what enters it is unknown.

        Log-odds stay where they are; slots of bricks that leave are free for those that enter.
        """
        bricks, shape = self.bricks, self.shape
        slots = bricks.slot[leaving(shape, step)]
        self._free(slots[slots != UNIFORM])
        moved = {
            name: shifted(getattr(bricks, name), shape, step, fill)
            for name, fill in _ENTERS.items()
        }
        self.bricks = bricks._replace(**moved)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Bricks along x, y, z."""
        nx, ny, nz = (int(count) for count in self.bricks.shape)
        return nx, ny, nz

    def known(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return (M, 3) indices and (M, 512) log-odds of the bricks that know anything."""
        rows = known_rows(self.bricks)
        index = np.stack(np.unravel_index(rows, self.shape), axis=1)
        return index.astype(np.int16), self.log_odds(rows)

    def is_known(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (M,) whether the bricks at `rows` (M,) of the directory know anything."""
        slot, value = self.bricks.slot[rows], self.bricks.value[rows]
        known: NDArray[np.bool_] = (slot != UNIFORM) | (value != UNKNOWN)
        return known

    def log_odds(self, rows: NDArray[np.int64]) -> NDArray[np.int16]:
        """Return (M, 512) log-odds of the bricks at `rows` (M,) of the directory."""
        bricks = self.bricks
        log_odds = np.repeat(bricks.value[rows, None], VOXELS, axis=1)
        is_open = bricks.slot[rows] != UNIFORM
        log_odds[is_open] = bricks.log_odds[bricks.slot[rows[is_open]]]
        return log_odds

    def log_odds_at(self, voxels: NDArray[np.int64]) -> NDArray[np.int16]:
        """Return (N,) log-odds of voxels (N, 3) of the window."""
        bricks, (i, j, k) = self.bricks, voxels.T & 7
        rows = np.ravel_multi_index(tuple(voxels.T >> 3), self.shape)
        slot = bricks.slot[rows]
        held: NDArray[np.int16] = bricks.log_odds[slot, 64 * i + 8 * j + k]
        return np.where(slot == UNIFORM, bricks.value[rows], held)

    def restore(self, index: NDArray[np.int16], log_odds: NDArray[np.int16]) -> None:
        """Replace everything by what `known` returned."""
        self.clear()
        rows = np.ravel_multi_index(tuple(index.astype(np.int64).T), self.shape)
        self.put(rows, log_odds)

    def put(self, rows: NDArray[np.int64], log_odds: NDArray[np.int16]) -> None:
        """Give bricks that are unknown, at `rows` (M,), the log-odds (M, 512) of now."""
        uniform = (log_odds == log_odds[:, :1]).all(axis=1)
        opened = rows[~uniform]
        bricks = self.bricks
        bricks.dirty[rows] = 1
        bricks.faded[rows] = bricks.clock[0]
        bricks.expiry[rows] = bricks.clock[0]
        bricks.value[rows[uniform]] = log_odds[uniform, 0]
        height = int(bricks.num_free[0]) - len(opened)
        slots = bricks.free_slots[height : height + len(opened)]
        bricks.slot[opened] = slots
        bricks.log_odds[slots] = log_odds[~uniform]
        bricks.num_free[:] = height, min(height, int(bricks.num_free[1]))

    def _free(self, slots: NDArray[np.int32]) -> None:
        bricks, height = self.bricks, int(self.bricks.num_free[0])
        bricks.free_slots[height : height + len(slots)] = slots
        bricks.num_free[0] = height + len(slots)


def clipped(log_odds: NDArray[np.int16], low: int, high: int) -> NDArray[np.int16]:
    """Return log-odds, of any shape, within clamps; unknown stays unknown."""
    within = np.clip(log_odds, low, high).astype(np.int16)
    return np.where(log_odds == UNKNOWN, np.int16(UNKNOWN), within)


def num_touched(bricks: Bricks) -> int:
    """Return how many slots of the pool were ever used: the first so many."""
    return len(bricks.free_slots) - int(bricks.num_free[1])


def known_rows(bricks: Bricks) -> NDArray[np.int64]:
    """Return (M,) rows of the directory whose bricks know anything, in order."""
    return np.flatnonzero((bricks.slot != UNIFORM) | (bricks.value != UNKNOWN))
