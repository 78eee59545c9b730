"""How far it is to the nearest occupied voxel."""

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels.bricks import BRICK, UNIFORM, UNKNOWN, VOXELS, Bricks
from services.mapper import checks
from services.mapper.box import Box
from services.mapper.errors import BadPoints, MissingScipy
from services.mapper.questions import Bounds, Part, log_odds_of, part_of, touched

UnknownIs = Literal["free", "occupied"]
"""What unknown voxels of the box count as; nothing is known to be outside of it."""


def field(
    bricks: Bricks, box: Box, bounds_m: Bounds | None, reach_m: float, unknown_is: UnknownIs
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return distances between voxel centres, and the field's origin; see `VoxelMap`.

    Source: Maurer, Qi, Raghavan, A Linear Time Algorithm for Computing Exact Euclidean Distance
    Transforms, PAMI 25(2), 2003 (scipy's `distance_transform_edt`).
    """
    _check(reach_m, unknown_is)
    wanted = part_of(box, bounds_m)
    # What lies outside the bounds counts as well, as far as the field reaches.
    wide = wanted if bounds_m is None else part_of(box, bounds_m, reach_m)
    obstacle = _obstacles(log_odds_of(bricks, wide), unknown_is)
    distance_m = np.full(obstacle.shape, reach_m, np.float32)
    if obstacle.any():
        transform = _scipy().ndimage.distance_transform_edt
        distance_m = np.minimum(transform(~obstacle, sampling=box.resolution_m), reach_m)
    i, j, k = wanted.first - wide.first
    nx, ny, nz = wanted.shape
    inner = distance_m[i : i + nx, j : j + ny, k : k + nz].astype(np.float32)
    return inner, box.centres_m(wanted.first[None])[0]


def to_points(
    bricks: Bricks, box: Box, points_m: ArrayLike, reach_m: float, unknown_is: UnknownIs
) -> NDArray[np.float64]:
    """Return the (N,) distances of points to the nearest voxel centre; see `VoxelMap`."""
    _check(reach_m, unknown_is)
    points = checks.rows_of_three(points_m)
    distance_m = np.full(len(points), np.nan)
    finite = np.isfinite(points).all(axis=1)
    distance_m[finite] = reach_m
    part = _part_near(box, points[finite], reach_m)
    if part is None:
        return distance_m
    if unknown_is == "free":
        centres_m = _occupied_m(bricks, box, part)
    else:
        obstacle = _obstacles(log_odds_of(bricks, part), unknown_is)
        centres_m = box.centres_m(np.argwhere(_rim(obstacle)) + part.first)
    if len(centres_m):
        tree = _scipy().spatial.cKDTree(centres_m)
        found = tree.query(points[finite], distance_upper_bound=reach_m)[0]
        distance_m[finite] = np.minimum(found, reach_m)
    if unknown_is == "occupied":
        _enter(distance_m, points, box, part, obstacle)
    return distance_m


def _enter(
    distance_m: NDArray[np.float64],
    points: NDArray[np.float64],
    box: Box,
    part: Part,
    obstacle: NDArray[np.bool_],
) -> None:
    """Write the distance of points that lie in an obstacle: its own voxel's centre is nearest."""
    voxels = box.keys(points)
    local = voxels - part.first
    here: NDArray[np.bool_] = np.asarray(((local >= 0) & (local < part.shape)).all(axis=1))
    here[here] = obstacle[tuple(local[here].T)]
    centres_m = box.centres_m(voxels[here])
    distance_m[here] = np.minimum(
        np.linalg.norm(points[here] - centres_m, axis=1), distance_m[here]
    )


def _part_near(box: Box, points: NDArray[np.float64], reach_m: float) -> Part | None:
    """Return the part of the box that is within reach of any point, if one is."""
    end_m = box.origin_m + np.asarray(box.shape) * box.resolution_m
    near = points[((points > box.origin_m - reach_m) & (points < end_m + reach_m)).all(axis=1)]
    if len(near) == 0:
        return None
    low = np.maximum(near.min(axis=0) - reach_m, box.origin_m)
    high = np.minimum(near.max(axis=0) + reach_m, end_m)
    part = touched(box, low, high)
    return part if (part.shape > 0).all() else None  # A point hardly within reach touches none.


def _occupied_m(bricks: Bricks, box: Box, part: Part) -> NDArray[np.float64]:
    """Return the (N, 3) centres of the occupied voxels, of bricks that a part touches."""
    rows = np.flatnonzero((bricks.slot != UNIFORM) | (bricks.value >= 0))
    index = np.stack(np.unravel_index(rows, tuple(bricks.shape)), axis=1)
    last = part.first + part.shape - 1
    inside = ((index >= part.first // BRICK) & (index <= last // BRICK)).all(axis=1)
    rows, index = rows[inside], index[inside]
    slots = bricks.slot[rows]
    occupied = np.repeat(bricks.value[rows, None] >= 0, VOXELS, axis=1)
    occupied[slots != UNIFORM] = bricks.log_odds[slots[slots != UNIFORM]] >= 0
    which, local = np.nonzero(occupied)
    within = np.stack([local >> 6, (local >> 3) & 7, local & 7], axis=1)
    return box.centres_m(index[which] * BRICK + within)


def _rim(obstacle: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the voxels of obstacles with a neighbour that is none; only these can be nearest.

    From outside: of two centres in a row the one towards the point is nearer.
    """
    inner = obstacle.copy()
    for axis in range(3):
        whole = np.moveaxis(obstacle, axis, 0)
        kept = np.moveaxis(inner, axis, 0)
        kept[1:] &= whole[:-1]
        kept[:-1] &= whole[1:]
        kept[0] = kept[-1] = False
    return obstacle & ~inner


def _obstacles(log_odds: NDArray[np.int16], unknown_is: UnknownIs) -> NDArray[np.bool_]:
    occupied: NDArray[np.bool_] = log_odds >= 0
    return occupied if unknown_is == "free" else occupied | (log_odds == UNKNOWN)


def _check(reach_m: float, unknown_is: str) -> None:
    if not reach_m > 0.0:
        raise BadPoints(f"reach {reach_m} m must be positive")
    if unknown_is not in get_args(UnknownIs):
        raise BadPoints(f"unknown_is {unknown_is!r}; known: {', '.join(get_args(UnknownIs))}")


def _scipy() -> Any:
    try:
        import scipy.ndimage
        import scipy.spatial
    except ImportError as error:
        raise MissingScipy(
            f"distances need scipy ({error}): pip install 'encircle[queries]'"
        ) from error
    return scipy
