"""The occupied voxels of the map, kept up to date from what the mapper publishes."""

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from schemas.map import BRICK_SIDE, OCCUPIED, MapChanges, MapFull
from services.kernels.voxel_keys import IntArray, pack, unpack

FloatArray = NDArray[np.float64]

_OFF_LATTICE = 1e-3
"""Voxels. Origins are whole multiples of the resolution in double precision: 10^6 voxels from the
frame's origin they are right to 10^-9."""


class Outcome(Enum):
    """What became of a message."""

    APPLIED = "applied"
    STALE = "stale"
    """Older than what the mirror holds; ignored."""
    GAP = "gap"
    """Something was missed, or the map is another; the mirror is as before and needs `map/full`."""


class MapMirror:
    """Follows one mapper: feed it every `MapChanges`, and a `MapFull` after a gap.

    Holds the occupied voxels as sorted keys, so that an instant costs time in the changes and
    one pass over the occupied, and memory does not grow with the map's box.
    """

    def __init__(self) -> None:
        self._keys: IntArray = np.empty(0, np.int64)
        self._latest: MapChanges | MapFull | None = None

    def apply(self, changes: MapChanges) -> Outcome:
        """Bring the mirror from `base_rev` to `rev`.

        Base 0 is the empty map: such changes start the mirror afresh, whatever it held. If the
        map's box has moved by whole voxels, what has left it is dropped.
        """
        if changes.base_rev and changes.base_rev != self.rev:
            return Outcome.STALE if changes.rev <= self.rev else Outcome.GAP
        held = np.empty(0, np.int64)
        if changes.base_rev and self._latest is not None:
            step = _step(self._latest, changes)
            if step is None:
                return Outcome.GAP
            held = _moved(self._keys, step, changes.shape_voxels)
        occupied = changes.classes == OCCUPIED
        if len(held) == 0:
            self._keys = np.sort(pack(changes.voxels[occupied]))
        else:
            keys = pack(changes.voxels)
            self._keys = _replace(held, keys, keys[occupied])
        self._latest = changes
        return Outcome.APPLIED

    def reset(self, full: MapFull) -> Outcome:
        """Take over a snapshot, unless the mirror is already past it."""
        if self._latest is not None and full.rev < self.rev:
            return Outcome.STALE
        brick, i, j, k = np.nonzero(full.log_odds >= 0)
        corner = full.bricks[brick].astype(np.int64) * BRICK_SIDE
        self._keys = np.sort(pack(corner + np.stack([i, j, k], axis=1)))
        self._latest = full
        return Outcome.APPLIED

    def forget(self) -> None:
        """Start anew: the mapper is another one."""
        self._keys, self._latest = np.empty(0, np.int64), None

    @property
    def rev(self) -> int:
        """The revision held; 0 before the first."""
        return 0 if self._latest is None else self._latest.rev

    @property
    def latest(self) -> MapChanges | MapFull | None:
        """The last message taken in: tick, resolution, origin and pose of what is held."""
        return self._latest

    def __len__(self) -> int:
        """How many voxels are occupied."""
        return len(self._keys)

    @property
    def voxels(self) -> IntArray:
        """(N, 3) indices i, j, k of the occupied voxels, in lexicographic order."""
        return unpack(self._keys)

    def centres(self) -> FloatArray:
        """Return the (N, 3) centres of the occupied voxels in the map's frame, metres."""
        if self._latest is None:
            return np.empty((0, 3))
        inside = (self.voxels + 0.5) * self._latest.resolution_m
        centres: FloatArray = np.asarray(self._latest.origin) + inside
        return centres


def _step(before: MapChanges | MapFull, after: MapChanges) -> IntArray | None:
    """Return by how many voxels (3,) the box has moved; None if the lattice is another."""
    step = (np.asarray(after.origin) - np.asarray(before.origin)) / after.resolution_m
    whole = np.round(step)
    if before.resolution_m != after.resolution_m or (np.abs(step - whole) > _OFF_LATTICE).any():
        return None
    moved: IntArray = whole.astype(np.int64)
    return moved


def _moved(keys: IntArray, step: IntArray, shape: tuple[int, int, int]) -> IntArray:
    """Count indices from a box's new corner and drop what it has left behind; sorted as before."""
    if not step.any():
        return keys
    voxels = unpack(keys) - step
    return pack(voxels[((voxels >= 0) & (voxels < shape)).all(axis=1)])


def _replace(held: IntArray, touched: IntArray, present: IntArray) -> IntArray:
    """Take `touched` out of the sorted `held`, then put `present` in; sorted again."""
    at = np.searchsorted(held, touched)
    hit = at < len(held)
    hit[hit] = held[at[hit]] == touched[hit]
    kept = np.delete(held, at[hit])
    present = np.sort(present)
    return np.insert(kept, np.searchsorted(kept, present), present)
