"""How far one depth image sees, in windows of every width that the map asks for."""

import numpy as np
from numpy.typing import NDArray

from services.kernels import levels

_Chain = list[NDArray[np.uint16]]


class Sight:
    """Buffers of one image size, (height, width), reused from image to image."""

    def __init__(self, height: int, width: int) -> None:
        self.shape = (height, width)
        rows, columns = (height + 1) // 2, (width + 1) // 2
        self._fine = _chain(height, width, levels.NUM_FINE)
        self._coarse = _chain(rows, columns, levels.NUM_COARSE + 1)
        # Zeroed pages cost nothing until a level is used.
        self._fine_m = np.zeros((len(self._fine), height + 1, width + 1), np.float32)
        self._coarse_m = np.zeros((len(self._coarse), rows + 1, columns + 1), np.float32)
        tiles = (-(-rows // levels.TILE), -(-columns // levels.TILE))
        self._nearest, self._farthest = np.empty(tiles, np.uint16), np.empty(tiles, np.uint16)
        self._depth = np.empty((0, 0), np.uint16)
        self._limit, self._scale_m = np.uint16(0), np.float32(0)

    def look(self, depth: NDArray[np.uint16], limit: np.uint16, scale_m: float) -> None:
        """Take an image in: raw depths, cut at `limit`, metres per unit."""
        self._depth, self._limit, self._scale_m = depth, limit, np.float32(scale_m)
        levels.halve(depth, limit, self._coarse[0])
        levels.tiles(self._coarse[0], self._nearest, self._farthest)

    def tiles(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the nearest and farthest reach of every 8x8 pixels, m."""
        return self._nearest * self._scale_m, self._farthest * self._scale_m

    def levels(
        self, used: NDArray[np.int32]
    ) -> tuple[NDArray[np.float32], int, NDArray[np.float32], int]:
        """Prepare the levels named in `used`; return fine, row pitch, coarse, row pitch (m)."""
        is_used = np.bincount(used, minlength=levels.NUM_FINE + levels.NUM_COARSE) > 0
        fine_used = is_used[: levels.NUM_FINE]
        if fine_used.any():
            levels.full(self._depth, self._limit, self._fine[0])
            self._widen(self._fine, fine_used, self._fine_m)
        # The first coarse level is two cells wide: level NUM_FINE is coarse window 2.
        self._widen(self._coarse, np.append(False, is_used[levels.NUM_FINE :]), self._coarse_m)
        fine, coarse = self._fine_m, self._coarse_m
        return (
            fine.reshape(len(fine), -1),
            fine.shape[2],
            coarse.reshape(len(coarse), -1),
            coarse.shape[2],
        )

    def _widen(
        self, chain: _Chain, is_used: NDArray[np.bool_], metres: NDArray[np.float32]
    ) -> None:
        for n in range(int(np.flatnonzero(is_used)[-1]) + 1 if is_used.any() else 0):
            if n > 0:
                widen = levels.widen_to_even if n % 2 else levels.widen_to_odd
                widen(chain[n - 1], chain[n])
            if is_used[n]:
                levels.to_metres(chain[n], self._scale_m, metres[n])


def _chain(rows: int, columns: int, count: int) -> _Chain:
    """Windows 1.., those of an even number of cells have one more row and column."""
    return [np.empty((rows + n % 2, columns + n % 2), np.uint16) for n in range(count)]
