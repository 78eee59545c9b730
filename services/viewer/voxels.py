"""The occupied voxels as points: since when they are, how sure they are, and in which colour."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from schemas.map import LOG_ODDS_PER_UNIT, MapChanges, MapFull
from services.kernels.voxel_keys import IntArray, pack
from services.viewer.colours import PLASMA, VIRIDIS, Colours, shades
from services.viewer.primitives import Points

MAX_DRAWN = 50_000
"""More takes a browser without a graphics card below two frames per second."""
_OLD_S = 5.0
_GROUND_VOXELS = 1.0
"""Lower centres hold the ground or its noise."""
_GROUND_COLOUR = (176, 180, 188)
_MIX = np.uint64(0x9E3779B97F4A7C15)  # Knuth's multiplicative hash, 2^64 / the golden ratio.


class ColourBy(Enum):
    """What a voxel's colour tells."""

    HEIGHT = "height"
    PROBABILITY = "probability"
    AGE = "age"


@dataclass(frozen=True)
class _Snapshot:
    """The occupied of a whole map, in the order of their keys."""

    full: MapFull
    keys: IntArray
    inside: IntArray
    sure: NDArray[np.float32]
    """Probability of each."""


class Voxels:
    """Follows what is occupied from frame to frame; costs time and memory in the occupied only."""

    def __init__(self) -> None:
        self._keys: IntArray = np.empty(0, np.int64)
        self._born_ns: IntArray = np.empty(0, np.int64)
        self._snapshot: _Snapshot | None = None
        self._held: MapChanges | MapFull | None = None
        self._inside: IntArray = np.empty((0, 3), np.int64)

    def update(self, held: MapChanges | MapFull, voxels: IntArray) -> None:
        """Take over a mirror's state.

        Args:
            held: The message that it was last brought up to date with.
            voxels: (N, 3) indices of the occupied.
        """
        keys = pack(voxels + _corner(held))
        order = np.argsort(keys, kind="stable")  # Quick, as mirrors keep them in this order.
        keys, self._inside = keys[order], voxels[order]
        born = np.full(len(keys), held.t_ns, np.int64)
        backwards = self._held is not None and held.t_ns < self._held.t_ns
        if len(self._keys) and not backwards:
            at, known = _find(self._keys, keys)
            born[known] = self._born_ns[at[known]]
        self._keys, self._born_ns, self._held = keys, born, held

    def learn(self, full: MapFull) -> None:
        """Take a snapshot with its probabilities: by these, it is what is drawn.

        Of what deforms half of the voxels are others at the next instant, and would have none.
        """
        if self._snapshot is not None and self._snapshot.full is full:
            return
        brick, i, j, k = np.nonzero(full.log_odds >= 0)
        inside = full.bricks[brick].astype(np.int64) * 8 + np.stack([i, j, k], axis=1)
        keys = pack(inside + _corner(full))
        odds = full.log_odds[brick, i, j, k].astype(np.float32) * np.float32(LOG_ODDS_PER_UNIT)
        order = np.argsort(keys)
        sure = (1 / (1 + np.exp(-odds)))[order]
        self._snapshot = _Snapshot(full, keys[order], inside[order], sure)

    def __len__(self) -> int:
        """How many are occupied."""
        return len(self._keys)

    @property
    def held(self) -> MapChanges | MapFull | None:
        """What the voxels were last brought up to date with."""
        return self._held

    @property
    def centres_m(self) -> NDArray[np.float64]:
        """(N, 3) all of them, map frame."""
        if self._held is None:
            return np.empty((0, 3))
        inside = (self._inside + np.float64(0.5)) * self._held.resolution_m
        centres: NDArray[np.float64] = (inside + self._held.origin).astype(np.float64)
        return centres

    def probabilities(self) -> NDArray[np.float32]:
        """Return (N,) how sure the map is that each is occupied; 0.5 where it was not asked."""
        out = np.full(len(self._keys), 0.5, np.float32)
        if self._snapshot is not None and len(self._snapshot.keys):
            at, known = _find(self._snapshot.keys, self._keys)
            out[known] = self._snapshot.sure[at[known]]
        return out

    def ages_s(self) -> NDArray[np.float64]:
        """Return (N,) for how long each has been occupied without a break, as seen from here."""
        newest = 0 if self._held is None else self._held.t_ns
        ages: NDArray[np.float64] = (newest - self._born_ns) / np.float64(1e9)
        return ages

    def points(self, by: ColourBy, limit: int = MAX_DRAWN) -> Points | None:
        """Return what to draw, at most `limit` of them; None before the first map.

        Of too many always the same are left out, evenly all over, so that the rest holds still.
        """
        held = self._held
        if held is None:
            return None
        snapshot = self._snapshot if by is ColourBy.PROBABILITY else None
        if snapshot is not None and snapshot.full.resolution_m == held.resolution_m:
            drawn = _thinned(snapshot.keys, limit)
            corner, inside = np.asarray(snapshot.full.origin), snapshot.inside[drawn]
            colours = shades(snapshot.sure[drawn], 0.5, 1.0, PLASMA)
            num_true = len(snapshot.keys)
        else:
            drawn = _thinned(self._keys, limit)
            corner, inside = np.asarray(held.origin), self._inside[drawn]
            height_m = (inside[:, 2] + 0.5) * held.resolution_m + corner[2]
            colours = self._colours(by, drawn, height_m, held.resolution_m)
            num_true = len(self._keys)
        T = held.pose.matrix()
        T[:3, 3] += T[:3, :3] @ corner  # Small numbers for the browser's single precision.
        positions = ((inside + 0.5) * held.resolution_m).astype(np.float32)
        return Points(positions, colours, held.resolution_m, T, num_true)

    def _colours(
        self, by: ColourBy, drawn: IntArray, height_m: NDArray[np.float64], size_m: float
    ) -> Colours:
        match by:
            case ColourBy.HEIGHT:
                top = float(height_m.max()) if len(height_m) else 0.0
                colours = shades(height_m, 0.0, np.ceil(top * 10) / 10, VIRIDIS)
                colours[height_m < _GROUND_VOXELS * size_m] = _GROUND_COLOUR
                return colours
            case ColourBy.PROBABILITY:
                return shades(self.probabilities()[drawn], 0.5, 1.0, PLASMA)
            case ColourBy.AGE:
                return shades(-self.ages_s()[drawn], -_OLD_S, 0.0, PLASMA)


def _corner(held: MapChanges | MapFull) -> IntArray:
    corner: IntArray = np.round(np.asarray(held.origin) / held.resolution_m).astype(np.int64)
    return corner


def _thinned(keys: IntArray, limit: int) -> IntArray:
    """Return the places of at most `limit` keys."""
    if len(keys) <= limit:
        return np.arange(len(keys))
    lot = keys.astype(np.uint64) * _MIX
    return np.sort(np.argpartition(lot, limit)[:limit])


def _find(keys: IntArray, wanted: IntArray) -> tuple[IntArray, NDArray[np.bool_]]:
    """Return where in the sorted `keys` each wanted one is, and whether it is there at all."""
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return at, keys[at] == wanted
