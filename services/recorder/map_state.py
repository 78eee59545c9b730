"""The map at any time of a recording, from its snapshots and what changed since."""

from collections import deque

import numpy as np

from schemas.map import BRICK_SIDE, FREE, OCCUPIED, MapChanges, MapFull
from schemas.message import Envelope
from services.kernels.voxel_keys import IntArray, pack, unpack

_UNKNOWN = -32768
_HIT, _MISS = 6941, -3322
"""Log-odds of OctoMap's one hit and one miss, fixed point: what a voxel is given of which only the
class was told, as the mapper does in its own snapshots."""
_VOXELS = BRICK_SIDE**3
_OF_CLASS = np.array([_UNKNOWN, _MISS, _HIT], np.int16)
_STRIDES = np.array([BRICK_SIDE * BRICK_SIDE, BRICK_SIDE, 1])
_MOST_EARLY = 64  # Four seconds; a snapshot's answer overtakes or is overtaken by a few.
_OFF_LATTICE = 1e-3  # Voxels; origins are whole multiples of the resolution.


class MapState:
    """Follows `map/full` and `map/changes` in the order in which they were recorded.

    Unlike those who only draw the map it keeps free voxels too, so that it can tell the whole map
    to others: `full` to whoever asks, `anew` to all after a leap in time.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self.envelope: Envelope | None = None
        """Of the last message taken in."""
        self._latest: MapChanges | MapFull | None = None
        self._early: deque[MapChanges] = deque(maxlen=_MOST_EARLY)
        """Changes that came before the snapshot they lead on from."""
        self._keys: IntArray = np.empty(0, np.int64)
        self._log_odds = np.empty((0, _VOXELS), np.int16)

    @property
    def known(self) -> bool:
        """Whether the whole map is known."""
        return self._latest is not None

    @property
    def rev(self) -> int:
        """The revision of what is known."""
        return 0 if self._latest is None else self._latest.rev

    def take(self, message: MapChanges | MapFull, envelope: Envelope) -> None:
        """Take in the next message of the recording; one of another mapper begins anew."""
        if self.envelope is not None and envelope.boot != self.envelope.boot:
            self.forget()
        if isinstance(message, MapFull):
            self._take_full(message)
        else:
            self._take_changes(message)
        self.envelope = envelope

    def full(self) -> MapFull | None:
        """Return the map as a snapshot; None if it is not known.

        Classes are those of now, log-odds those of the last snapshot: changes do not tell them.
        """
        if self._latest is None:
            return None
        rows = np.concatenate([unpack(self._keys).astype(np.int16), self._log_odds], axis=1)
        return MapFull.of(rows, **self._head(self._latest))

    def anew(self) -> MapChanges | None:
        """Return the map as changes from the empty one; None if it is not known."""
        if self._latest is None:
            return None
        brick, voxel = np.nonzero(self._log_odds != _UNKNOWN)
        inside = np.stack(np.unravel_index(voxel, (BRICK_SIDE,) * 3), axis=1)
        rows = np.empty((len(brick), 4), np.int16)
        rows[:, :3] = unpack(self._keys)[brick] * BRICK_SIDE + inside
        rows[:, 3] = np.where(self._log_odds[brick, voxel] >= 0, OCCUPIED, FREE)
        return MapChanges.of(rows, base_rev=0, **self._head(self._latest))

    def _head(self, latest: MapChanges | MapFull) -> dict[str, object]:
        names = {"t_ns", "tick", "frame_id", "rev", "resolution_m", "origin", "shape_voxels"}
        return {**{name: getattr(latest, name) for name in names}, "pose": latest.pose}

    def _take_full(self, full: MapFull) -> None:
        if self.known and full.rev < self.rev:
            return  # It was asked for before, and came after, what is known.
        keys = pack(full.bricks)
        order = np.argsort(keys)
        self._keys = keys[order]
        self._log_odds = full.log_odds.reshape(-1, _VOXELS)[order]
        self._latest = full
        early = list(self._early)
        self._early.clear()
        for changes in early:
            self._take_changes(changes)

    def _take_changes(self, changes: MapChanges) -> None:
        if changes.base_rev == 0:
            self.forget()
        elif changes.rev <= self.rev:
            return
        elif self._latest is None or changes.base_rev != self.rev or not self._move_to(changes):
            self._latest = None  # Something is missing: only the next snapshot can tell.
            self._early.append(changes)
            return
        bricks = pack(changes.voxels // BRICK_SIDE)
        self._add(np.setdiff1d(bricks, self._keys))
        voxels = (changes.voxels % BRICK_SIDE) @ _STRIDES
        self._log_odds[np.searchsorted(self._keys, bricks), voxels] = _OF_CLASS[changes.classes]
        self._latest = changes

    def _move_to(self, changes: MapChanges) -> bool:
        """Count bricks from where the box is now; False if the lattice is another."""
        before = self._latest
        assert before is not None
        step = (np.asarray(changes.origin) - np.asarray(before.origin)) / changes.resolution_m
        bricks = np.round(step / BRICK_SIDE)
        if before.resolution_m != changes.resolution_m:
            return False
        if (np.abs(step - bricks * BRICK_SIDE) > _OFF_LATTICE).any():
            return False
        if bricks.any():
            index = unpack(self._keys) - bricks.astype(np.int64)
            shape = -(-np.asarray(changes.shape_voxels) // BRICK_SIDE)
            inside = ((index >= 0) & (index < shape)).all(axis=1)
            self._keys, self._log_odds = pack(index[inside]), self._log_odds[inside]
        return True

    def _add(self, keys: IntArray) -> None:
        if not len(keys):
            return
        at = np.searchsorted(self._keys, keys)
        self._keys = np.insert(self._keys, at, keys)
        self._log_odds = np.insert(self._log_odds, at, np.int16(_UNKNOWN), axis=0)
