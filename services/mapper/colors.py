"""The colors of a map's voxels: a pool beside that of the log-odds, only there when asked for."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.kernels import colors
from services.kernels.bricks import UNIFORM, VOXELS, Bricks
from services.mapper.box import Box
from services.mapper.brick_store import known_rows, num_touched
from services.mapper.stored_map import UNCOLORED
from services.mapper.view import View


class Palette(Protocol):
    """What a map knows of colors; by slot of the pool, so that a window may move."""

    def forget(self, bricks: Bricks) -> None:
        """Forget the colors of slots that are unused now: before they are used anew."""

    def with_picture(
        self, bricks: Bricks, box: Box, view: View, picture: NDArray[np.uint8]
    ) -> "Palette":
        """Add a checked image's colors (H, W, 3), after its depths have been fused."""

    def of_known(self, bricks: Bricks) -> NDArray[np.uint8]:
        """Return (M, 512, 3) colors of the bricks that know anything, in the directory's order."""

    @property
    def num_bytes(self) -> int:
        """Bytes held."""


class Uncolored:
    """No color was ever given."""

    num_bytes = 0

    def forget(self, bricks: Bricks) -> None:
        """There is nothing to forget."""

    def with_picture(
        self, bricks: Bricks, box: Box, view: View, picture: NDArray[np.uint8]
    ) -> Palette:
        """Begin to know."""
        return Colors().with_picture(bricks, box, view, picture)

    def of_known(self, bricks: Bricks) -> NDArray[np.uint8]:
        """Know none."""
        return np.full((len(known_rows(bricks)), VOXELS, 3), UNCOLORED, np.uint8)


class Colors:
    """Running means of what pixels showed, 7 bytes per voxel of an open brick.

    A brick that closes (all of it free for sure, or unknown) forgets its colors, as does one that
    leaves the window.
    """

    def __init__(self) -> None:
        self._mean = np.empty((0, VOXELS, 3), np.uint16)
        self._count = np.zeros((0, VOXELS), np.uint8)
        self._used = np.zeros(0, np.uint8)

    def forget(self, bricks: Bricks) -> None:
        """Forget the colors of slots that are unused now: before they are used anew."""
        unused = bricks.free_slots[: bricks.num_free[0]]
        unused = unused[unused < len(self._used)]
        stale = unused[self._used[unused] == 1]
        self._count[stale] = 0
        self._used[stale] = 0

    def with_picture(
        self, bricks: Bricks, box: Box, view: View, picture: NDArray[np.uint8]
    ) -> Palette:
        """Add a checked image's colors (H, W, 3), after its depths have been fused."""
        self._follow(num_touched(bricks))
        shape = np.asarray(box.shape, np.int32)
        rays = np.stack(view.pixels_in(box))
        colors.add_colors(
            bricks,
            view.depth,
            picture,
            view.limit,
            rays,
            shape,
            self._mean,
            self._count,
            self._used,
        )
        return self

    def put(self, bricks: Bricks, rows: NDArray[np.int64], color: NDArray[np.uint8]) -> None:
        """Give bricks at `rows` (M,) the colors (M, 512, 3), each for one look."""
        self._follow(num_touched(bricks))
        is_open = bricks.slot[rows] != UNIFORM
        slots, given = bricks.slot[rows[is_open]], color[is_open]
        self._mean[slots] = given.astype(np.uint16) * colors.UNIT
        self._count[slots] = (given != UNCOLORED).any(axis=2)
        self._used[slots] = 1

    def of_known(self, bricks: Bricks) -> NDArray[np.uint8]:
        """Return (M, 512, 3) colors of the bricks that know anything, in the directory's order."""
        rows = known_rows(bricks)
        out = np.full((len(rows), VOXELS, 3), UNCOLORED, np.uint8)
        slots = bricks.slot[rows]
        held = (slots != UNIFORM) & (slots < len(self._used))
        mean = (self._mean[slots[held]] + np.uint16(colors.UNIT // 2 - 1)) // colors.UNIT
        known = self._count[slots[held]] > 0
        out[held] = np.where(known[..., None], mean, UNCOLORED).astype(np.uint8)
        return out

    @property
    def num_bytes(self) -> int:
        """Bytes held."""
        return self._mean.nbytes + self._count.nbytes + self._used.nbytes

    def _follow(self, num_slots: int) -> None:
        """Grow as the pool of the log-odds has, in powers of two."""
        before, num_slots = len(self._used), 1 << max(num_slots - 1, 0).bit_length()
        if num_slots > before:
            mean = np.empty((num_slots, VOXELS, 3), np.uint16)
            mean[:before] = self._mean
            added = num_slots - before
            self._mean = mean
            self._count = np.concatenate([self._count, np.zeros((added, VOXELS), np.uint8)])
            self._used = np.concatenate([self._used, np.zeros(added, np.uint8)])
