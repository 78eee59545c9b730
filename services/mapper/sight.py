"""How far one depth image sees, in windows of every size that the map asks for."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels import levels
from services.kernels.levels import (
    EXACT,
    NUM_EXACT,
    NUM_FINE,
    PAD,
    PIXEL_PAD,
    RIM_CELLS,
    RIM_PX,
    WIDEST_PX,
    WIDTHS,
)

SLACK = 2
"""Cells around the span of centres in which they may be looked up."""
TIGHT = 0.2
"""Cells by which short sides are rounded down rather than up: planes that are seen edge-on would be
seen through otherwise (benchmarks/mapping_agreement.py)."""


class Sights(NamedTuple):
    """Raw reach in windows, for `carve`."""

    fine: NDArray[np.uint16]
    """Planes at full resolution, flat: the exact ones, then levels 1 .."""
    fine_shape: NDArray[np.int32]
    """(2,) rows and columns of a plane."""
    coarse: NDArray[np.uint16]
    """Planes of cells of 2x2 pixels, likewise: levels NUM_FINE .."""
    coarse_shape: NDArray[np.int32]
    windows: NDArray[np.int32]
    """(NUM_LEVELS, 2) rows and columns of a level's window, pixels or cells."""


def windows(aspect: float) -> NDArray[np.int32]:
    """Return (NUM_LEVELS, 2) rows and columns of windows that are `aspect` as wide as they are."""
    fine, coarse = np.arange(1, NUM_FINE + 1), WIDTHS
    across = np.concatenate([fine, coarse])[:, None] * np.array([1 / aspect, aspect])
    widest = np.repeat([WIDEST_PX, int(WIDTHS[-1])], [len(fine), len(coarse)])[:, None]
    short = across < across.max(axis=1, keepdims=True)
    sizes: NDArray[np.int32] = np.clip(np.round(across - TIGHT * short), 1, widest).astype(np.int32)
    # Three windows of a power of two, side by side, are all that `widen` puts together.
    powers = 2 ** np.floor(np.log2(sizes.min(axis=1, keepdims=True))).astype(np.int32)
    bounded: NDArray[np.int32] = np.minimum(sizes, 3 * powers)
    return bounded


class Sight:
    """Buffers of one image size, (height, width), reused from image to image."""

    def __init__(self, height: int, width: int) -> None:
        self.shape = (height, width)
        rows, columns = (height + 1) // 2, (width + 1) // 2
        table = (levels.NUM_DOUBLINGS, rows + 2 * PAD, columns + 2 * PAD)
        self._maxima = np.zeros(table, np.uint16)
        self._left = np.zeros(table, np.uint16)
        # Zeroed pages cost nothing until a level is used.
        self._pixels = np.zeros((2, height + 2 * PIXEL_PAD, width + 2 * PIXEL_PAD), np.uint16)
        fine = (NUM_EXACT + NUM_FINE - 1, height + 2 * RIM_PX, width + 2 * RIM_PX)
        self._fine = np.zeros(fine, np.uint16)
        coarse = (len(WIDTHS), rows + 2 * RIM_CELLS, columns + 2 * RIM_CELLS)
        self._coarse = np.zeros(coarse, np.uint16)
        self._depth, self._limit = np.empty((0, 0), np.uint16), np.uint16(0)

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """Return all buffers."""
        return self._left, self._maxima, self._pixels, self._fine, self._coarse

    def look(self, depth: NDArray[np.uint16], limit: np.uint16) -> None:
        """Take an image in: raw depths, cut at `limit`."""
        self._depth, self._limit = depth, limit
        levels.halve(depth, limit, self._maxima[0])
        inner = np.s_[PAD:-PAD, PAD:-PAD]
        np.subtract(levels.MOST, self._maxima[0][inner], out=self._left[0][inner])
        for level in range(1, len(self._maxima)):
            reach = 1 << (level - 1)
            for table in (self._maxima, self._left):
                levels.double(table[level - 1], reach, table[level])

    def tables(self) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        """Return maxima in windows of 1, 2, 4 .. cells: of what the reach leaves to MOST, of it."""
        return self._left, self._maxima

    def levels(self, spans: NDArray[np.int32], sizes: NDArray[np.int32]) -> Sights:
        """Prepare what voxels will be looked up in.

        Args:
            spans: (NUM_LEVELS, 4), see `cull`: only there.
            sizes: (NUM_LEVELS, 2), see `windows`.
        """
        is_used = spans[:, 1] >= spans[:, 0]
        if is_used[:NUM_FINE].any():
            levels.cut(self._depth, self._limit, self._pixels[0])
            levels.double(self._pixels[0], 1, self._pixels[1])
        if is_used[EXACT]:
            for plane in range(NUM_EXACT):
                size = (1 + plane // 2, 1 + plane % 2)
                self._widen_pixels(size, (0, 0), spans[EXACT], self._fine[plane])
        for level in np.flatnonzero(is_used[1:NUM_FINE]) + 1:
            down, right = (int(side) for side in sizes[level])
            plane = self._fine[NUM_EXACT + level - 1]
            self._widen_pixels((down, right), (down // 2, right // 2), spans[level], plane)
        for level in np.flatnonzero(is_used[NUM_FINE:]):
            down, right = (int(side) for side in sizes[NUM_FINE + level])
            doubling = min(down, right).bit_length() - 1
            first = (PAD - RIM_CELLS - down // 2, PAD - RIM_CELLS - right // 2)
            plane = self._coarse[level]
            part = _part(spans[NUM_FINE + level] // 2, RIM_CELLS, plane.shape)
            source = self._maxima[doubling]
            levels.widen(source, 1 << doubling, (down, right), first, part, plane)
        return Sights(
            self._fine.reshape(-1),
            np.asarray(self._fine.shape[1:], np.int32),
            self._coarse.reshape(-1),
            np.asarray(self._coarse.shape[1:], np.int32),
            sizes,
        )

    def _widen_pixels(
        self,
        size: tuple[int, int],
        back: tuple[int, int],
        span: NDArray[np.int32],
        plane: NDArray[np.uint16],
    ) -> None:
        doubling = 0 if min(size) == 1 else 1
        first = (PIXEL_PAD - RIM_PX - back[0], PIXEL_PAD - RIM_PX - back[1])
        part = _part(span, RIM_PX, plane.shape)
        levels.widen(self._pixels[doubling], 1 << doubling, size, first, part, plane)


def _part(span: NDArray[np.int32], rim: int, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return first and end row, first and end column of a plane, for centres in a span of cells."""
    top, bottom, left, right = (int(edge) + rim for edge in span)
    # A centre is rounded to a cell or a corner beside it, an exact window begins a cell before.
    rows = max(top - SLACK, 0), min(bottom + SLACK + 1, shape[0])
    columns = max(left - SLACK, 0), min(right + SLACK + 1, shape[1])
    return rows[0], max(rows[1], rows[0]), columns[0], max(columns[1], columns[0])
