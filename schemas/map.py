"""The fused map as it travels: what changed, the whole of it, and one line about it."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from schemas.camera import MAX_CAMERAS, CameraIndex
from schemas.geometry import Pose, Vector3
from schemas.message import ArrayLayout, ArrayMessage, Message, UInt64

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
LOG_ODDS_PER_UNIT = 1 / 8192
"""A stored int16 times this is a log-odds; -32768 is unknown."""
BRICK_SIDE = 8
_VOXELS_PER_BRICK = BRICK_SIDE**3

Count = Annotated[int, Field(ge=0)]
Milliseconds = Annotated[float, Field(ge=0)]
VoxelCounts = tuple[Count, Count, Count]
Resolution = Annotated[float, Field(gt=0, le=100)]


class _MapArray(ArrayMessage):
    rev: UInt64
    """Counts up with every instant that was fused."""
    resolution_m: Resolution
    origin: Vector3
    """Corner of voxel (0, 0, 0) in the map's frame, metres. A box that follows something moves, by
    whole voxels: what leaves it is forgotten, of what enters it all that is known is told."""
    shape_voxels: VoxelCounts
    """Size of the map's box."""
    pose: Pose
    """The map's frame in `world` at this instant."""


class MapChanges(_MapArray):
    """Voxels whose class changed since `base_rev`: rows i, j, k, class.

    When `base_rev` is not the revision you have, you missed some: ask `map/full`. Indices count
    from `origin`, which may have moved since. More changes than fit come with the next revisions.
    """

    LAYOUT: ClassVar[ArrayLayout] = ArrayLayout("<i2", (None, 4), 256 << 20)

    base_rev: UInt64

    @property
    def voxels(self) -> NDArray[np.int16]:
        """(N, 3) voxel indices."""
        rows: NDArray[np.int16] = self.array[:, :3]
        return rows

    @property
    def classes(self) -> NDArray[np.int16]:
        """(N,) 0 unknown, 1 free, 2 occupied."""
        column: NDArray[np.int16] = self.array[:, 3]
        return column


class MapFull(_MapArray):
    """A snapshot: per brick of 8 x 8 x 8 voxels its index and its log-odds, C order."""

    LAYOUT: ClassVar[ArrayLayout] = ArrayLayout("<i2", (None, 3 + _VOXELS_PER_BRICK), 256 << 20)

    @property
    def bricks(self) -> NDArray[np.int16]:
        """(M, 3) brick indices; brick b covers voxels 8 b .. 8 b + 7."""
        columns: NDArray[np.int16] = self.array[:, :3]
        return columns

    @property
    def log_odds(self) -> NDArray[np.int16]:
        """(M, 8, 8, 8) fixed point log-odds, see `LOG_ODDS_PER_UNIT`; -32768 is unknown."""
        shape = (-1, BRICK_SIDE, BRICK_SIDE, BRICK_SIDE)
        columns: NDArray[np.int16] = self.array[:, 3:].reshape(shape)
        return columns


Cameras = Annotated[tuple[CameraIndex, ...], Field(max_length=MAX_CAMERAS)]


class MapSummary(Message):
    """One instant has been fused and published."""

    rev: UInt64
    cameras_used: Cameras
    cameras_missing: Cameras
    num_returns: Count
    """Depth returns of this instant, all cameras."""
    num_occupied: Count
    num_free: Count
    num_changed: Count
    fuse_ms: Milliseconds
    """Time spent fusing this instant's clouds."""
    latency_ms: Milliseconds
    """First shutter of the instant to its changes published."""
    entropy_bits: Annotated[float, Field(ge=0)] | None = None
    """Of all voxels in the box; None when not computed at this instant."""
    late_clouds: Count = 0
    """Clouds that came after their instant had been closed, since start."""
    memory: Literal["persistent", "instant", "decay"]
    origin: Vector3 | None = None
    """Corner of the map's box in the map's frame, m; it moves if the box follows something."""
    archived_bricks: Count = 0
    """Bricks of 8 x 8 x 8 voxels that are remembered outside the box."""
    num_dynamic: Count = 0
    """Occupied voxels that had been free for long before; 0 if nobody asked the mapper to watch."""
