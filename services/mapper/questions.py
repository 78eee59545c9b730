"""What can be asked of a map's bricks: the voxels of a part of the box, rays."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels import sight_lines
from services.kernels.bricks import BRICK, CLASS_FREE, UNIFORM, UNKNOWN, VOXELS, Bricks
from services.mapper import checks
from services.mapper.answers import RayHits
from services.mapper.box import Box
from services.mapper.errors import BadBox, BadPoints, TooMuchAsked

MAX_VOXELS = 1 << 25
"""Most voxels that are laid out densely at a time: a distance field of them needs 640 MiB."""
_SNAP = 1e-6  # voxels; absorbs the rounding of bounds such as 0.6 / 0.01.
Bounds = tuple[Sequence[float], Sequence[float]]
"""Least and greatest corner, map frame, m."""


class Part(NamedTuple):
    """Voxels first .. first + shape - 1 of a box."""

    first: NDArray[np.int64]
    shape: NDArray[np.int64]

    @property
    def num_voxels(self) -> int:
        """Voxels in the part."""
        return math.prod(int(n) for n in self.shape)


def part_of(box: Box, bounds_m: Bounds | None, margin_m: float = 0.0) -> Part:
    """Return the voxels of the box that bounds touch; all of them if there are no bounds.

    Args:
        box: the map's. bounds_m: least and greatest corner, map frame.
        margin_m: by which the bounds are widened on every side.

    Raises:
        BadBox: If the bounds are not finite, have no volume or lie outside the box.
    """
    if bounds_m is None:
        return Part(np.zeros(3, np.int64), np.asarray(box.shape, np.int64))
    ends = checks.numbers(bounds_m, BadBox, "bounds must be two corners x, y, z")
    if ends.shape[:1] != (2,):
        raise BadBox(f"bounds have shape {ends.shape}; they must be two corners x, y, z")
    low, high = ends
    if low.shape != (3,) or high.shape != (3,):
        raise BadBox(f"bounds have shapes {low.shape} and {high.shape}; each must be x, y, z")
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
        raise BadBox(f"bounds {low} .. {high} m must be finite and have a volume on every axis")
    part = touched(box, low - margin_m, high + margin_m)
    if (part.shape <= 0).any():
        ends_m = box.origin_m, box.origin_m + np.asarray(box.shape) * box.resolution_m
        raise BadBox(f"bounds {low} .. {high} m lie outside the box {ends_m[0]} .. {ends_m[1]}")
    return part


def touched(box: Box, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Part:
    """Return the voxels of the box that a part of space (3,), (3,) touches; maybe none."""
    first, unit = np.asarray(box.first_key), box.resolution_m
    corner = np.maximum(0.0, np.floor(low_m / unit - first + _SNAP))
    end = np.minimum(box.shape, np.ceil(high_m / unit - first - _SNAP))
    return Part(corner.astype(np.int64), (end - corner).astype(np.int64))


def log_odds_of(bricks: Bricks, part: Part) -> NDArray[np.int16]:
    """Return the log-odds (1/8192; -32768 unknown) of a part, in its shape.

    Raises:
        TooMuchAsked: If it has more than MAX_VOXELS voxels.
    """
    if part.num_voxels > MAX_VOXELS:
        raise TooMuchAsked(
            f"{part.num_voxels} voxels are to be laid out (their margin, if any, included); "
            f"at most {MAX_VOXELS}"
        )
    first, last = part.first // BRICK, (part.first + part.shape - 1) // BRICK
    index = np.meshgrid(
        *(np.arange(a, b + 1) for a, b in zip(first, last, strict=True)), indexing="ij"
    )
    rows = np.ravel_multi_index(tuple(index), tuple(bricks.shape))
    slots = bricks.slot[rows]
    blocks = np.empty((*rows.shape, VOXELS), np.int16)
    blocks[:] = bricks.value[rows][..., None]
    is_open = slots != UNIFORM
    blocks[is_open] = bricks.log_odds[slots[is_open]]
    whole = blocks.reshape(*rows.shape, BRICK, BRICK, BRICK).transpose(0, 3, 1, 4, 2, 5)
    dense = whole.reshape([n * BRICK for n in rows.shape])
    i, j, k = part.first - first * BRICK
    nx, ny, nz = part.shape
    return dense[i : i + nx, j : j + ny, k : k + nz]


def unknown_centres_m(bricks: Bricks, box: Box, part: Part) -> NDArray[np.float64]:
    """Return the (N, 3) centres, map frame, m, of the unknown voxels of a part."""
    return box.centres_m(np.argwhere(log_odds_of(bricks, part) == UNKNOWN) + part.first)


def cast_rays(
    bricks: Bricks,
    box: Box,
    origins_m: ArrayLike,
    directions: ArrayLike,
    max_range_m: float,
    unknown_stops: bool,
) -> RayHits:
    """Cast rays; see `VoxelMap.cast_rays`.

    Raises:
        BadPoints: If origins or directions are not (N, 3) each, or the range is not positive.
    """
    origins, ways = checks.rows_of_three(origins_m), checks.rows_of_three(directions)
    if ways.shape != origins.shape:
        raise BadPoints(f"{len(origins)} origins and {len(ways)} directions; as many must be given")
    if not max_range_m > 0.0:
        raise BadPoints(f"maximum range {max_range_m} m must be positive")
    count = len(origins)
    outcome, distance_m = np.empty(count, np.uint8), np.full(count, np.inf)
    voxels = np.zeros((count, 3), np.int64)
    key0 = np.asarray(box.first_key, np.int64)
    sight_lines.cast(
        bricks,
        origins,
        ways,
        key0,
        box.resolution_m,
        float(max_range_m),
        bool(unknown_stops),
        outcome,
        voxels,
        distance_m,
    )
    distance_m[outcome == sight_lines.INVALID] = np.nan
    nowhere = (outcome == sight_lines.INVALID) | (outcome == CLASS_FREE)
    centres_m = box.centres_m(voxels)
    centres_m[nowhere] = np.nan
    return RayHits(outcome, centres_m, distance_m)
