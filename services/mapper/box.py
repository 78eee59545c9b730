"""The grid: a box of whole bricks on the voxel lattice of the map frame; it can move by bricks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels.bricks import BRICK
from services.mapper import checks
from services.mapper.errors import BadBox, MapTooLarge
from services.mapper.shift import Step

BYTES_PER_VOXEL = 2.25
"""When every brick is open and told: log-odds 2, the class that was told 1/4."""
BYTES_PER_BRICK = 192
"""Of the directories and of the integrators' lists and marks, whatever is seen."""
MAX_BYTES = 4 << 30
"""A box that could need more is refused: a map must not take a robot's memory by surprise."""
MAX_VOXELS_PER_AXIS = 32767  # map/changes carries int16 indices.
MAX_KEY = 1 << 20
"""Keys lie within this of the map frame's origin, 52 km at 5 cm: single precision still tells a
voxel's sixteenth apart there, and three keys fit 63 bits."""
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
            BadBox: If a bound is not finite, the volume is zero, the voxel size not positive, or
                the box farther from the origin than MAX_KEY voxels.
            MapTooLarge: If the bricks could need more than MAX_BYTES.
        """
        resolution_m = checks.number(resolution_m, BadBox, "voxel size")
        if not (math.isfinite(resolution_m) and resolution_m > 0.0):
            raise BadBox(f"voxel size {resolution_m} m must be positive and finite")
        low, high = (
            checks.numbers(bound, BadBox, "bounds must each be x, y, z")
            for bound in (bounds_min_m, bounds_max_m)
        )
        if low.shape != (3,) or high.shape != (3,):
            raise BadBox(f"bounds have shapes {low.shape} and {high.shape}; each must be x, y, z")
        if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
            raise BadBox(f"box {low} .. {high} m must be finite and have a volume on every axis")
        first = np.floor(low / resolution_m + _SNAP)
        # However thin: a box has a voxel.
        voxels = np.maximum(np.ceil(high / resolution_m - _SNAP) - first, 1.0)
        per_brick = BRICK**3 * BYTES_PER_VOXEL + BYTES_PER_BRICK
        num_bytes = float(np.prod(np.ceil(voxels / BRICK))) * per_brick
        if num_bytes > MAX_BYTES or voxels.max() > MAX_VOXELS_PER_AXIS:
            raise MapTooLarge(
                f"box {low} .. {high} m at {resolution_m} m voxels is {np.prod(voxels):.3g} voxels "
                f"and up to {num_bytes / 2**30:.3g} GiB; at most {MAX_BYTES / 2**30:.0f} GiB and "
                f"{MAX_VOXELS_PER_AXIS} voxels per axis are allowed"
            )
        _check_keys(first, np.ceil(voxels / BRICK) * BRICK, resolution_m)
        i, j, k = (int(key) for key in first)
        bx, by, bz = (int(n) for n in np.ceil(voxels / BRICK))
        return cls(float(resolution_m), (i, j, k), (bx, by, bz))

    def moved(self, step: Step) -> "Box":
        """Return the box moved by whole bricks along x, y, z.

        Raises:
            BadBox: If it would lie farther from the origin than MAX_KEY voxels.
        """
        first = np.asarray(self.first_key, np.float64) + BRICK * np.asarray(step, np.float64)
        _check_keys(first, np.asarray(self.shape), self.resolution_m)
        i, j, k = (int(key) for key in first)
        return Box(self.resolution_m, (i, j, k), self.num_bricks)

    def step_to(self, centre_m: ArrayLike, slack_bricks: float) -> Step:
        """Return the bricks to move by so that the box is centred on a point.

        Args:
            centre_m: (3,) the point, map frame.
            slack_bricks: the box stays along every axis on which the point is no farther from its
                centre; at 1 a point has to go back a whole brick before the box does.

        Raises:
            BadBox: If the point is not three finite numbers within MAX_KEY voxels of the origin.
        """
        centre = checks.numbers(centre_m, BadBox, "centre must be x, y, z")
        if centre.shape != (3,) or not (np.abs(centre) <= MAX_KEY * self.resolution_m).all():
            raise BadBox(
                f"centre {centre.tolist()} m must be x, y, z within {MAX_KEY * self.resolution_m} m"
            )
        middle = np.asarray(self.first_key) + np.asarray(self.shape) / 2
        off = (centre / self.resolution_m - middle) / BRICK
        steps = np.where(np.abs(off) > slack_bricks, np.round(off), 0.0)
        x, y, z = (int(step) for step in steps)
        return x, y, z

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


def _check_keys(first: NDArray[np.float64], voxels: NDArray[Any], resolution_m: float) -> None:
    if (first < -MAX_KEY).any() or (first + voxels > MAX_KEY).any():
        low, high = first * resolution_m, (first + voxels) * resolution_m
        raise BadBox(
            f"box {low} .. {high} m at {resolution_m} m voxels must lie within {MAX_KEY} voxels of "
            f"the map frame's origin, {MAX_KEY * resolution_m:g} m; choose larger voxels or a map "
            "frame that is nearer"
        )
