"""What a window of bricks keeps when it moves, and what leaves it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Step = tuple[int, int, int]
"""By how many bricks along x, y, z."""


def shifted(directory: NDArray[Any], shape: Step, step: Step, fill: Any) -> NDArray[Any]:
    """Return a directory (B, ...) whose window has moved by `step`; what enters holds `fill`."""
    out = np.full((*shape, *directory.shape[1:]), fill, directory.dtype)
    here, there = _overlap(shape, step)
    out[here] = directory.reshape(out.shape)[there]
    return out.reshape(directory.shape)


def leaving(shape: Step, step: Step) -> NDArray[np.int64]:
    """Return the rows of the bricks that a window leaves behind when it moves by `step`."""
    gone = np.ones(shape, bool)
    gone[_overlap(shape, step)[1]] = False
    return np.flatnonzero(gone)


def _overlap(shape: Step, step: Step) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return where what stays is after the move, and where it was before."""
    pairs = list(zip(shape, step, strict=True))
    here = tuple(slice(max(-s, 0), max(n - max(s, 0), 0)) for n, s in pairs)
    there = tuple(slice(max(s, 0), max(n - max(-s, 0), 0)) for n, s in pairs)
    return here, there
