"""The grid: a box of whole bricks on the voxel lattice of the map frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import BRICK
from services.mapper.errors import BadBox, MapTooLarge

BYTES_PER_VOXEL = 4
"""When every brick is open: log-odds 2, stamp 1, published class 1."""
MAX_BYTES = 4 << 30
"""A box that could need more is refused: a map must not take a robot's memory by surprise."""
MAX_VOXELS_PER_AXIS = 32767  # map/changes carries int16 indices.
_SNAP = 1e-6  # voxels; absorbs the rounding of bounds such as 0.6 / 0.01.


@dataclass(frozen=True)
class Box:
    """Voxel (i, j, k) covers origin + [i, i+1) * resolution_m."""

    resolution_m: float
    first_key: tuple[int, int, int]
    """Lattice coordinates of voxel (0, 0, 0): OctoMap's keys, minus 32768."""
    num_bricks: tuple[int, int, int]

    @classmethod
    def covering(
        cls, resolution_m: float, bounds_min_m: Sequence[float], bounds_max_m: Sequence[float]
    ) -> "Box":
        """Snap bounds outward to the voxel lattice and to whole bricks.

        Raises:
            BadBox: If a bound is not finite, the volume is zero or the voxel size not positive.
            MapTooLarge: If the voxels could need more than MAX_BYTES.
        """
        if not (math.isfinite(resolution_m) and resolution_m > 0.0):
            raise BadBox(f"voxel size {resolution_m} m must be positive and finite")
        low, high = np.asarray(bounds_min_m, np.float64), np.asarray(bounds_max_m, np.float64)
        if low.shape != (3,) or high.shape != (3,):
            raise BadBox(f"bounds have shapes {low.shape} and {high.shape}; each must be x, y, z")
        if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
            raise BadBox(f"box {low} .. {high} m must be finite and have a volume on every axis")
        first = np.floor(low / resolution_m + _SNAP)
        voxels = np.ceil(high / resolution_m - _SNAP) - first
        num_bytes = float(np.prod(np.ceil(voxels / BRICK) * BRICK)) * BYTES_PER_VOXEL
        if num_bytes > MAX_BYTES or voxels.max() > MAX_VOXELS_PER_AXIS:
            raise MapTooLarge(
                f"box {low} .. {high} m at {resolution_m} m voxels is {np.prod(voxels):.3g} voxels "
                f"and up to {num_bytes / 2**30:.3g} GiB; at most {MAX_BYTES / 2**30:.0f} GiB and "
                f"{MAX_VOXELS_PER_AXIS} voxels per axis are allowed"
            )
        i, j, k = (int(key) for key in first)
        bx, by, bz = (int(n) for n in np.ceil(voxels / BRICK))
        return cls(float(resolution_m), (i, j, k), (bx, by, bz))

    @property
    def origin_m(self) -> NDArray[np.float64]:
        """(3,) corner of voxel (0, 0, 0), map frame."""
        return np.asarray(self.first_key, np.float64) * self.resolution_m

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along x, y, z."""
        bx, by, bz = self.num_bricks
        return BRICK * bx, BRICK * by, BRICK * bz

    @property
    def num_voxels(self) -> int:
        """Voxels in the box."""
        return math.prod(self.shape)

    def keys(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the (N, 3) voxel each point (map frame, m) lies in; may lie outside the box."""
        lattice = np.floor(points_m * (1.0 / self.resolution_m))
        finite = np.nan_to_num(lattice, nan=-1e15, posinf=1e15, neginf=-1e15)
        keys: NDArray[np.int64] = np.clip(finite, -1e15, 1e15).astype(np.int64)
        return keys - np.asarray(self.first_key, np.int64)

    def centres_m(self, voxels: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the (N, 3) centres of voxels, map frame, m."""
        centres: NDArray[np.float64] = (
            voxels + np.asarray(self.first_key) + 0.5
        ) * self.resolution_m
        return centres
