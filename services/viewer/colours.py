"""Numbers to colours."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Colours = NDArray[np.uint8]
Rgb = tuple[int, int, int]

# Anchors of matplotlib's viridis and plasma (both CC0): even to the eye, also to colour-blind ones.
_VIRIDIS = (
    "440154",
    "472c7a",
    "3b518b",
    "2c718e",
    "21908d",
    "27ad81",
    "5cc863",
    "aadc32",
    "fde725",
)
_PLASMA = ("0d0887", "4b03a1", "7d03a8", "a82296", "cb4679", "e56b5d", "f89441", "fdc328", "f0f921")
_STEPS = 256

CAMERA_COLOURS: tuple[Rgb, ...] = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (213, 94, 0),
    (0, 114, 178),
    (204, 121, 167),
)
"""One per camera, over again beyond six: Okabe and Ito, Color Universal Design, 2008."""


def _table(anchors: tuple[str, ...]) -> Colours:
    corners = np.array([list(bytes.fromhex(anchor)) for anchor in anchors], np.float64)
    at, along = np.linspace(0, 1, len(anchors)), np.linspace(0, 1, _STEPS)
    columns = [np.interp(along, at, corners[:, channel]) for channel in range(3)]
    table: Colours = np.stack(columns, axis=1).round().astype(np.uint8)
    return table


VIRIDIS, PLASMA = _table(_VIRIDIS), _table(_PLASMA)


def shades(values: ArrayLike, low: float, high: float, table: Colours) -> Colours:
    """Return a colour per value: the table's first up to `low`, its last from `high` on.

    Args:
        values: (...) numbers; NaN counts as `low`.
        low: what the table's first row stands for.
        high: what its last row stands for; not above `low`: all have the first.
        table: (256, 3) rows.

    Returns:
        (..., 3).
    """
    span = high - low
    share = (np.asarray(values, np.float32) - low) / span if span > 0 else np.zeros_like(values)
    index = np.clip(np.nan_to_num(share, nan=0.0) * (_STEPS - 1), 0, _STEPS - 1)
    out: Colours = table[index.astype(np.intp)]
    return out


def camera_colour(camera: int) -> Rgb:
    """Return the colour by which a camera is known everywhere in the view."""
    return CAMERA_COLOURS[camera % len(CAMERA_COLOURS)]
