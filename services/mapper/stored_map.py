"""A map outside of the mapper's memory: what files hold and conversions hand on."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels.bricks import BRICK, UNKNOWN, VOXELS
from services.mapper.archive import Block
from services.mapper.box import Box
from services.mapper.errors import BadMapFile, MapTooLarge
from services.mapper.sensor_model import SensorModel

UNCOLORED = 255
"""On all three channels: nothing is known of a voxel's color (OctoMap's convention)."""
MAX_BYTES = 1 << 29
"""What a file may unfold to that can say much in few bytes: 268 million voxels without color."""


@dataclass(frozen=True, eq=False)
class StoredMap:
    """The bricks that know anything, in no order.

    Raises:
        BadMapFile: If shapes, types or indices do not fit each other.
    """

    box: Box
    sensor: SensorModel
    bricks: NDArray[np.int16]
    """(M, 3) indices within the box, each at most once."""
    log_odds: NDArray[np.int16]
    """(M, 512) in 1/8192, element 64*i + 8*j + k; -32768 is unknown."""
    color: NDArray[np.uint8] | None = None
    """(M, 512, 3) red, green, blue; white is UNCOLORED."""

    def __post_init__(self) -> None:
        """Check shapes, types and indices."""
        rows = len(self.bricks)
        _check("bricks", self.bricks, np.int16, (rows, 3))
        _check("log_odds", self.log_odds, np.int16, (rows, VOXELS))
        if self.color is not None:
            _check("color", self.color, np.uint8, (rows, VOXELS, 3))
        outside = ((self.bricks < 0) | (self.bricks >= self.box.num_bricks)).any(axis=1)
        if outside.any():
            raise BadMapFile(
                f"brick {self.bricks[outside][0].tolist()} does not lie in the box of "
                f"{self.box.num_bricks} bricks"
            )
        place = np.ravel_multi_index(tuple(self.bricks.astype(np.int64).T), self.box.num_bricks)
        num_places = len(np.unique(place))
        if num_places < rows:
            raise BadMapFile(f"{rows - num_places} of {rows} bricks are there twice")


def gathered(box: Box, sensor: SensorModel, blocks: Iterable[Block]) -> StoredMap:
    """Return the map of all blocks (indices relative to `box`, at least one), the box grown to it.

    Raises:
        BadBox, MapTooLarge: If no map may have that box.
    """
    index, log_odds = zip(*blocks, strict=True)
    bricks = np.concatenate(index).astype(np.int64)
    low = np.minimum(0, bricks.min(axis=0, initial=0))
    high = np.maximum(box.num_bricks, bricks.max(axis=0, initial=0) + 1)
    if low.any() or tuple(high) != box.num_bricks:
        box = box_of(box.resolution_m, np.asarray(box.first_key) + BRICK * low, high - low)
    return StoredMap(box, sensor, (bricks - low).astype(np.int16), np.concatenate(log_odds))


def box_of(resolution_m: float, first_key: ArrayLike, num_bricks: ArrayLike) -> Box:
    """Return the box of so many bricks (3,) from a voxel (3,) on.

    Raises:
        BadBox, MapTooLarge: If no map may have it.
    """
    first = np.asarray(first_key, np.float64)
    # One voxel of the last brick is enough to have it in the box.
    last = first + BRICK * (np.asarray(num_bricks, np.float64) - 1.0) + 1.0
    low, high = (first * resolution_m).tolist(), (last * resolution_m).tolist()
    return Box.covering(resolution_m, low, high)


class StoredVoxels(NamedTuple):
    """Voxels of a stored map that are occupied."""

    voxel: NDArray[np.int64]
    """(N, 3) within the box."""
    log_odds: NDArray[np.int16]
    """(N,) in 1/8192."""
    color: NDArray[np.uint8] | None
    """(N, 3)"""


def occupied(stored: StoredMap) -> StoredVoxels:
    """List the occupied voxels, brick by brick."""
    rows, local = np.nonzero(stored.log_odds >= 0)
    inside = np.stack([local >> 6, (local >> 3) & 7, local & 7], axis=1)
    index = stored.bricks[rows].astype(np.int64) * BRICK + inside
    color = None if stored.color is None else stored.color[rows, local]
    return StoredVoxels(index, stored.log_odds[rows, local], color)


def num_known(stored: StoredMap) -> tuple[int, int]:
    """Count the free and the occupied voxels."""
    num_occupied = int(np.count_nonzero(stored.log_odds >= 0))
    known = int(np.count_nonzero(stored.log_odds != UNKNOWN))
    return known - num_occupied, num_occupied


def check_size(num_bricks: int, bytes_per_voxel: int) -> None:
    """See to it that few bytes on disk do not take a machine's memory.

    Raises:
        MapTooLarge: If bricks would need more than MAX_BYTES.
    """
    num_bytes = num_bricks * VOXELS * bytes_per_voxel
    if num_bytes > MAX_BYTES:
        raise MapTooLarge(
            f"{num_bricks} bricks of {VOXELS} voxels need {num_bytes / 2**30:.3g} GiB; "
            f"at most {MAX_BYTES / 2**30:.3g} GiB are allowed"
        )


def _check(
    name: str, array: NDArray[np.int16] | NDArray[np.uint8], dtype: type, shape: tuple[int, ...]
) -> None:
    if array.dtype != dtype or array.shape != shape:
        raise BadMapFile(
            f"{name} is {array.dtype} {array.shape}; it must be {np.dtype(dtype)} {shape}"
        )
