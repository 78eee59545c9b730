"""What a moving window leaves behind: bricks on the lattice, kept until the window comes back.

In chunks of 8^3 bricks, which exist only where something is known: a move touches the chunks at the
window's rim, whatever the archive holds besides. Time stands still in the archive: what lies there
does not fade.
"""

import zlib
from collections.abc import Iterator
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import BRICK, UNKNOWN, VOXELS
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore, clipped

_SIDE = 8
"""Bricks along the edge of a chunk."""
_CHUNK_BYTES, _PACK_BYTES = 512, 33
"""Of Python's objects, per chunk and pack; the first is an estimate."""
_LEVEL = 1  # 4 us per brick; higher levels take twice as long for a tenth less.
ChunkKey = tuple[int, int, int]
Block = tuple[NDArray[np.int64] | NDArray[np.int16], NDArray[np.int16]]
"""(M, 3) bricks, relative to a box's first (so they may be negative), and (M, 512) log-odds."""
Clamps = tuple[int, int]
"""Least and greatest log-odds of what is known, 1/8192: the sensor model may have changed."""


class BehindWindow(Protocol):
    """What becomes of bricks that leave a window."""

    def receive(self, box: Box, store: BrickStore, rows: NDArray[np.int64]) -> None:
        """Take the bricks at `rows` (M,) of a store whose window is `box`."""

    def keep(self, box: Box, index: NDArray[np.int64], log_odds: NDArray[np.int16]) -> None:
        """Take known bricks that are not held: indices (N, 3) relative to `box`, and (N, 512)."""

    def hand_back(self, box: Box, store: BrickStore, clamps: Clamps) -> None:
        """Give a store the bricks in its window `box`, clamped, and keep them no longer."""

    def classify(self, box: Box, voxels: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return (N,) classes of voxels (N, 3), indices relative to `box`; 0 if not held."""

    def blocks(self, box: Box) -> Iterator[Block]:
        """Return all that is held, some bricks at a time."""

    def clear(self) -> None:
        """Forget everything."""

    num_bricks: int
    """Bricks held."""

    @property
    def num_bytes(self) -> int:
        """Bytes held."""


class Nothing:
    """Bricks that leave are forgotten: the window is all there is, and memory is bounded."""

    num_bricks = 0
    num_bytes = 0

    def receive(self, box: Box, store: BrickStore, rows: NDArray[np.int64]) -> None:
        """Forget them."""

    def keep(self, box: Box, index: NDArray[np.int64], log_odds: NDArray[np.int16]) -> None:
        """Forget them."""

    def hand_back(self, box: Box, store: BrickStore, clamps: Clamps) -> None:
        """There is nothing to give."""

    def classify(self, box: Box, voxels: NDArray[np.int64]) -> NDArray[np.uint8]:  # noqa: ARG002
        """Know nothing."""
        return np.zeros(len(voxels), np.uint8)

    def blocks(self, box: Box) -> Iterator[Block]:  # noqa: ARG002
        """Return nothing."""
        return iter(())

    def clear(self) -> None:
        """There is nothing to forget."""


class Chunk(NamedTuple):
    """Bricks by their place in the chunk: 64*i + 8*j + k."""

    value: NDArray[np.int16]
    """(512,) log-odds of uniform bricks; UNKNOWN where a brick is open or not held."""
    place: NDArray[np.int16]
    """(M,) of open bricks."""
    packs: tuple[bytes, ...]
    """Their log-odds, (M, 512) if unpacked and joined: neighbours are alike, most of a brick is
    free for sure, and a kilobyte becomes 160 bytes."""

    def with_bricks(self, place: NDArray[np.int64], log_odds: NDArray[np.int16]) -> "Chunk":
        """Return the chunk with more bricks, at places (N,) that were not held."""
        uniform = (log_odds == log_odds[:, :1]).all(axis=1)
        self.value[place[uniform]] = log_odds[uniform, 0]
        return Chunk(
            self.value,
            np.concatenate([self.place, place[~uniform].astype(np.int16)]),
            (*self.packs, *_packed(log_odds[~uniform])),
        )

    @property
    def log_odds(self) -> NDArray[np.int16]:
        """(M, 512) of open bricks."""
        unpacked = b"".join(zlib.decompress(pack) for pack in self.packs)
        return np.frombuffer(unpacked, np.int16).reshape(-1, VOXELS)

    def bricks(self, wanted: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int16]]:
        """Return places (N,) and log-odds (N, 512) of the bricks held where wanted (512,)."""
        uniform = np.flatnonzero(wanted & (self.value != UNKNOWN))
        is_open = wanted[self.place]
        rows = np.repeat(self.value[uniform, None], VOXELS, axis=1)
        place = np.concatenate([uniform, self.place[is_open]])
        return place, np.concatenate([rows, self.log_odds[is_open]])

    def without(self, gone: NDArray[np.bool_]) -> "Chunk":
        """Return the chunk without the bricks where gone (512,)."""
        self.value[gone] = UNKNOWN
        stays = ~gone[self.place]
        return Chunk(self.value, self.place[stays], _packed(self.log_odds[stays]))

    @property
    def num_bytes(self) -> int:
        """Bytes held."""
        packs = sum(len(pack) + _PACK_BYTES for pack in self.packs)
        return self.value.nbytes + self.place.nbytes + packs + _CHUNK_BYTES

    def holds_any(self, of: NDArray[np.bool_]) -> bool:
        """Whether a brick is held where of (512,)."""
        return bool(of[self.place].any() or (of & (self.value != UNKNOWN)).any())


class Archive:
    """Bricks that left the window, by their place on the lattice."""

    def __init__(self) -> None:
        self._chunks: dict[ChunkKey, Chunk] = {}
        self.num_bricks = 0

    def receive(self, box: Box, store: BrickStore, rows: NDArray[np.int64]) -> None:
        """Take the bricks at `rows` (M,) of a store whose window is `box`."""
        rows = rows[store.is_known(rows)]
        index = np.stack(np.unravel_index(rows, store.shape), axis=1)
        self.keep(box, index, store.log_odds(rows))

    def keep(self, box: Box, index: NDArray[np.int64], log_odds: NDArray[np.int16]) -> None:
        """Take known bricks that are not held: indices (N, 3) relative to `box`, and (N, 512)."""
        bricks = index + _first_brick(box)
        keys, member = np.unique(bricks // _SIDE, axis=0, return_inverse=True)
        member, place = member.reshape(-1), _place(bricks)
        self.num_bricks += len(bricks)
        for n, (x, y, z) in enumerate(keys.tolist()):
            mine = member == n
            chunk = self._chunks.get((x, y, z)) or _empty()
            self._chunks[x, y, z] = chunk.with_bricks(place[mine], log_odds[mine])

    def hand_back(self, box: Box, store: BrickStore, clamps: Clamps) -> None:
        """Give a store the bricks in its window `box`, clamped, and keep them no longer."""
        first = _first_brick(box)
        end = first + store.shape
        low, high = first // _SIDE, (end - 1) // _SIDE
        near = product(*(range(a, b + 1) for a, b in zip(low, high, strict=True)))
        for key in [key for key in near if key in self._chunks]:
            chunk, index = self._chunks[key], _bricks_of(key)
            inside = np.asarray(((index >= first) & (index < end)).all(axis=1))
            if not chunk.holds_any(inside):
                continue
            place, log_odds = chunk.bricks(inside)
            local = (index[place] - first).T
            rows = np.ravel_multi_index(tuple(local), store.shape)
            store.put(rows, clipped(log_odds, *clamps))
            self.num_bricks -= len(place)
            if chunk.holds_any(~inside):
                self._chunks[key] = chunk.without(inside)
            else:
                del self._chunks[key]

    def classify(self, box: Box, voxels: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return (N,) classes of voxels (N, 3), indices relative to `box`; 0 if not held."""
        bricks, local = voxels // BRICK + _first_brick(box), voxels % BRICK
        value = np.full(len(voxels), UNKNOWN, np.int16)
        keys, member = np.unique(bricks // _SIDE, axis=0, return_inverse=True)
        member, place = member.reshape(-1), _place(bricks)
        within = 64 * local[:, 0] + 8 * local[:, 1] + local[:, 2]
        for n, (x, y, z) in enumerate(keys.tolist()):
            if (chunk := self._chunks.get((x, y, z))) is None:
                continue
            mine = np.flatnonzero(member == n)
            row = np.full(_SIDE**3, -1)
            row[chunk.place] = np.arange(len(chunk.place))
            at = row[place[mine]]
            value[mine] = chunk.value[place[mine]]
            opened = mine[at >= 0]
            if len(opened):
                value[opened] = chunk.log_odds[at[at >= 0], within[opened]]
        return np.where(value == UNKNOWN, 0, np.where(value >= 0, 2, 1)).astype(np.uint8)

    def blocks(self, box: Box) -> Iterator[Block]:
        """Return all that is held, chunk by chunk."""
        everywhere = np.ones(_SIDE**3, bool)
        for key, chunk in self._chunks.items():
            place, log_odds = chunk.bricks(everywhere)
            yield _bricks_of(key)[place] - _first_brick(box), log_odds

    def clear(self) -> None:
        """Forget everything."""
        self._chunks.clear()
        self.num_bricks = 0

    @property
    def num_bytes(self) -> int:
        """Bytes held."""
        return sum(chunk.num_bytes for chunk in self._chunks.values())


def _empty() -> Chunk:
    value = np.full(_SIDE**3, UNKNOWN, np.int16)
    return Chunk(value, np.empty(0, np.int16), ())


def _packed(log_odds: NDArray[np.int16]) -> tuple[bytes, ...]:
    return (zlib.compress(log_odds.tobytes(), _LEVEL),) if len(log_odds) else ()


def _first_brick(box: Box) -> NDArray[np.int64]:
    """Return the lattice's brick at a box's corner; windows of one lattice differ by bricks."""
    return np.asarray(box.first_key, np.int64) // BRICK


def _place(bricks: NDArray[np.int64]) -> NDArray[np.int64]:
    i, j, k = (bricks % _SIDE).T
    place: NDArray[np.int64] = _SIDE * (_SIDE * i + j) + k
    return place


def _bricks_of(key: ChunkKey) -> NDArray[np.int64]:
    """Return the (512, 3) bricks of a chunk, in the order of their places."""
    index = np.stack(np.unravel_index(np.arange(_SIDE**3), (_SIDE,) * 3), axis=1)
    return index + np.asarray(key, np.int64) * _SIDE
