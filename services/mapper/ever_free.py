"""Which occupied voxels are dynamic: they have been free for long before."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.kernels import ever_free
from services.kernels.bricks import BRICK, VOXELS, Bricks
from services.mapper.shift import Step, leaving, shifted

FRAMES = 8
"""Instants that a voxel must surely be free before it counts as ever free: half a second at 15 Hz,
within which OctoMap's model reaches the lower clamp even with one camera."""
STAY = 60
"""Occupied instants after which what has come belongs to the background: 4 s at 15 Hz."""
_SURE = 0.75
"""Share of the lower clamp at which a voxel is surely free."""
_FIRST_ROWS = 64


class Watch(Protocol):
    """Follows the voxels of a store from instant to instant."""

    def observe(self, bricks: Bricks, low: int) -> None:
        """See the bricks at the end of an instant, before their changes are told.

        Args:
            low: the lower clamp, 1/8192.
        """

    def dynamic(self) -> NDArray[np.int64]:
        """Return (N, 3) the voxels of the window that are flagged."""

    def shift(self, step: Step) -> None:
        """Move the window by bricks; what leaves it is forgotten."""

    def clear(self) -> None:
        """Forget everything."""

    @property
    def num_dynamic(self) -> int:
        """How many voxels are flagged."""

    @property
    def num_bytes(self) -> int:
        """Bytes held."""


class Unwatched:
    """Nobody has asked: nothing is held."""

    num_dynamic = 0
    num_bytes = 0

    def observe(self, bricks: Bricks, low: int) -> None:
        """Look away."""

    def dynamic(self) -> NDArray[np.int64]:
        """Know none."""
        return np.empty((0, 3), np.int64)

    def shift(self, step: Step) -> None:
        """There is nothing to move."""

    def clear(self) -> None:
        """There is nothing to forget."""


class EverFreeWatch:
    """A byte per voxel of the bricks where it differs, else a byte per brick.

    Args:
        shape: bricks of the window along x, y, z.
        frames: instants (1 .. 63) that a voxel must surely be free to be ever free.
        stay: occupied instants (1 .. 63) after which it no longer is.
    """

    def __init__(self, shape: Step, frames: int = FRAMES, stay: int = STAY) -> None:
        assert 1 <= frames <= ever_free.MOST_INSTANTS
        assert 1 <= stay < ever_free.MOST_INSTANTS
        self._shape, self._frames, self._stay = shape, frames, stay
        num_bricks = int(np.prod(shape))
        self._ever = ever_free.EverFree(
            row=np.full(num_bricks, ever_free.ONE, np.int32),
            value=np.zeros(num_bricks, np.uint8),
            state=np.empty((0, VOXELS), np.uint8),
            free_rows=np.empty(0, np.int32),
            num_free=np.zeros(1, np.int64),
        )
        self._listed = np.empty(num_bricks, np.int32)

    def observe(self, bricks: Bricks, low: int) -> None:
        """See the bricks at the end of an instant, before their changes are told."""
        brick, count = 0, 0
        while True:
            brick, count = ever_free.observe(
                self._ever,
                bricks,
                brick,
                np.int32(_SURE * low),
                self._frames,
                self._stay,
                self._listed,
                count,
            )
            if brick == len(bricks.slot):
                break
            self._grow()
        ever_free.flag(self._ever, bricks.shape, self._listed, count)

    def dynamic(self) -> NDArray[np.int64]:
        """Return (N, 3) the voxels of the window that are flagged."""
        ever = self._ever
        held = np.flatnonzero(ever.row != ever_free.ONE)
        which, local = np.nonzero(ever.state[ever.row[held]] > ever_free.DYNAMIC)
        corner = np.stack(np.unravel_index(held[which], self._shape), axis=1) * BRICK
        inside = np.stack([local >> 6, (local >> 3) & 7, local & 7], axis=1)
        return corner.astype(np.int64) + inside

    def shift(self, step: Step) -> None:
        """Move the window by bricks; what leaves it is forgotten."""
        ever = self._ever
        gone = ever.row[leaving(self._shape, step)]
        gone = gone[gone != ever_free.ONE]
        height = int(ever.num_free[0])
        ever.free_rows[height : height + len(gone)] = gone
        ever.num_free[0] = height + len(gone)
        self._ever = ever._replace(
            row=shifted(ever.row, self._shape, step, ever_free.ONE),
            value=shifted(ever.value, self._shape, step, 0),
        )

    def clear(self) -> None:
        """Forget everything."""
        self._ever.row.fill(ever_free.ONE)
        self._ever.value.fill(0)
        self._ever.free_rows[:] = np.arange(len(self._ever.free_rows))
        self._ever.num_free[0] = len(self._ever.free_rows)

    @property
    def num_dynamic(self) -> int:
        """How many voxels are flagged."""
        return int(ever_free.count_dynamic(self._ever))

    @property
    def num_bytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for array in self._ever) + self._listed.nbytes

    def _grow(self) -> None:
        ever = self._ever
        before, most = len(ever.state), len(ever.row)
        total = min(max(2 * before, _FIRST_ROWS), most)
        state = np.empty((total, VOXELS), np.uint8)
        state[:before] = ever.state
        rows = np.empty(total, np.int32)
        rows[: total - before] = np.arange(before, total)
        # Only an empty stack grows.
        self._ever = ever._replace(state=state, free_rows=rows)
        self._ever.num_free[0] = total - before
