"""OctoMap's octree of a map: pruned leaves in Morton order, and back into bricks."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels import linear_octree, unfold
from services.kernels.bricks import BRICK, UNKNOWN, VOXELS
from services.mapper.errors import MapTooLarge
from services.mapper.sensor_model import SensorModel
from services.mapper.stored_map import UNCOLORED, StoredMap, box_of, check_size

_KEY_OF_ORIGIN = 1 << 15
"""OctoMap's key of the voxel at lattice coordinates 0, 0, 0."""
_COLOR_BITS = 24
_CORNERS = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)])
_SPREAD = np.array(
    [sum((n >> bit & 1) << 3 * bit for bit in range(8)) for n in range(256)], np.int64
)


class Leaves(NamedTuple):
    """The leaves of an octree whose voxels lie at depth 16."""

    code: NDArray[np.int64]
    """(L,) ascending Morton codes of the first voxel, x lowest."""
    depth: NDArray[np.uint8]
    """(L,) 16 for a voxel, 13 for 8^3 voxels."""
    log_odds: NDArray[np.int16]
    """(L,) in 1/8192."""
    color: NDArray[np.uint8] | None
    """(L, 3), or none in the whole tree."""


def leaves_of(stored: StoredMap, classes_only: bool = False) -> Leaves:
    """Prune a map: eight equal siblings are one leaf.

    Args:
        stored: the map.
        classes_only: forget colors, and all of log-odds but free (-1) and occupied (0).

    Raises:
        MapTooLarge: If a brick lies beyond the 65536 voxels of OctoMap's axes.
    """
    corner = stored.bricks.astype(np.int64) * BRICK + stored.box.first_key + _KEY_OF_ORIGIN
    if len(corner) and (corner.min() < 0 or corner.max() + BRICK > 2 * _KEY_OF_ORIGIN):
        reach = _KEY_OF_ORIGIN * stored.box.resolution_m
        raise MapTooLarge(
            f"voxels {corner.min(0) - _KEY_OF_ORIGIN} .. {corner.max(0) + BRICK - _KEY_OF_ORIGIN} "
            f"reach beyond OctoMap's {_KEY_OF_ORIGIN} voxels ({reach:.6g} m) from the origin"
        )
    ends = np.stack([corner, corner + BRICK - 1]) >> 3
    touched = np.stack(
        [_morton(np.stack([ends[c[a], :, a] for a in range(3)], axis=1)) for c in _CORNERS], axis=1
    )
    brick_code, rows = np.unique(touched, return_inverse=True)
    values, unknown = _values(stored, classes_only)
    aligned = np.full((len(brick_code), VOXELS), unknown, values.dtype)
    linear_octree.scatter_rows(values, corner, rows.reshape(-1, 8), aligned)
    room = np.count_nonzero(aligned != unknown)
    code, depth = np.empty(room, np.int64), np.empty(room, np.uint8)
    value = np.empty(room, values.dtype)
    count = linear_octree.prune(brick_code, aligned, unknown, code, depth, value)
    log_odds, color = _unpacked(value[:count])
    return Leaves(code[:count].copy(), depth[:count].copy(), log_odds, color)


def stored_from(leaves: Leaves, resolution_m: float, sensor: SensorModel) -> StoredMap:
    """Put leaves into the least box of bricks that holds them.

    Raises:
        BadBox, MapTooLarge: If that box, or what is known in it, is too much.
    """
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    count = unfold.extent(leaves.code, leaves.depth, low, high)
    if count == 0:
        low[:], high[:] = _KEY_OF_ORIGIN, _KEY_OF_ORIGIN + 1
    packed, unknown = _packed(leaves.log_odds, leaves.color)
    check_size(int(count), packed.itemsize)
    first = low >> 3
    box = box_of(resolution_m, first * BRICK - _KEY_OF_ORIGIN, -(-high // BRICK) - first)
    bricks = np.empty((count, 3), np.int16)
    values = np.empty((count, VOXELS), packed.dtype)
    unfold.unfold(leaves.code, leaves.depth, packed, unknown, first, bricks, values)
    return StoredMap(box, sensor, bricks, *_unpacked(values))


def _morton(bricks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the codes of bricks (M, 3) of 13-bit coordinates."""
    spread = _SPREAD[bricks & 255] | _SPREAD[bricks >> 8] << 24
    codes: NDArray[np.int64] = spread[:, 0] | spread[:, 1] << 1 | spread[:, 2] << 2
    return codes


def _values(stored: StoredMap, classes_only: bool) -> tuple[NDArray[np.signedinteger], int]:
    if not classes_only:
        return _packed(stored.log_odds, stored.color)
    known = stored.log_odds != UNKNOWN
    return np.where(known, stored.log_odds >> 15, UNKNOWN).astype(np.int16), UNKNOWN


def _packed(
    log_odds: NDArray[np.int16], color: NDArray[np.uint8] | None
) -> tuple[NDArray[np.signedinteger], int]:
    """Return one integer per voxel, log-odds above color, and the one of the unknown voxel."""
    if color is None:
        return log_odds, UNKNOWN
    rgb = color.astype(np.int64)
    rgb = rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]
    unknown = UNKNOWN << _COLOR_BITS
    above = log_odds.astype(np.int64) << _COLOR_BITS
    return np.where(log_odds == UNKNOWN, unknown, above | rgb), unknown


def _unpacked(
    value: NDArray[np.signedinteger],
) -> tuple[NDArray[np.int16], NDArray[np.uint8] | None]:
    if value.dtype == np.int16:
        return value.astype(np.int16), None
    rgb = np.stack([value >> shift & 255 for shift in (16, 8, 0)], axis=-1).astype(np.uint8)
    log_odds = (value >> _COLOR_BITS).astype(np.int16)
    rgb[log_odds == UNKNOWN] = UNCOLORED
    return log_odds, rgb
