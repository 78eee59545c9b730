"""Fuse an organised cloud by projecting the map into the image: each voxel once, or whole bricks.

OctoMap's update rules; free space is sampled at voxel centres over the voxel's footprint, not ray
by ray.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.kernels import carve, hits
from services.kernels.bricks import BRICK, VOXELS
from services.mapper.answers import Fused
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.sensor_model import SensorModel
from services.mapper.sight import Sight

INVALID = 0
"""A pixel that knows nothing."""
NO_RETURN = 65535
"""A pixel that looked and saw nothing: free up to the maximum range."""
FOOTPRINT = 1.25
"""Window over a voxel's projected edge; fitted to OctoMap's free space (benchmarks/mapping.py)."""
MARGIN = 0.5
"""Voxels that a return must lie behind a voxel's centre to free it."""


@dataclass(frozen=True)
class View:
    """One depth image: (H, W) uint16, where it was taken (map frame) and how to read it."""

    depth: NDArray[np.uint16]
    pinhole: tuple[float, float, float, float]
    T_map_camera: NDArray[np.float64]
    scale_m: float
    max_range_m: float


class ProjectiveIntegrator:
    """Fuses depth images into a store."""

    def __init__(self, box: Box, store: BrickStore, sensor: SensorModel) -> None:
        self._box, self._store = box, store
        self._update = sensor.fixed_point()
        total = store.bricks.slot.size
        self._listed = (
            np.empty(total, np.int32),
            np.empty(total, np.uint8),
            np.empty((total, 3), np.float32),
            np.empty(total, np.int32),
        )
        i, j, k = np.unravel_index(np.arange(VOXELS), (BRICK, BRICK, BRICK))
        self._voxels_m = (np.stack([i, j, k]) - (BRICK - 1) / 2) * box.resolution_m
        self._sight = Sight(1, 1)

    def fuse(self, view: View) -> Fused:
        """Fuse one checked image."""
        if view.depth.shape != self._sight.shape:
            self._sight = Sight(*view.depth.shape)
        scan = self._store.begin_scan()
        limit = np.uint16(min(int(view.max_range_m / view.scale_m), NO_RETURN - 1))
        num_hits = self._hit(view, limit, scan)  # the voxels that the pixels end in
        self._sight.look(view.depth, limit, view.scale_m)  # how far the image sees
        count = self._cull(view, scan)  # the bricks it says anything about
        self._carve(view, count, scan)  # the voxels it sees beyond
        num_returns = hits.count_returns(view.depth, INVALID, NO_RETURN)
        return Fused(num_hits, int(num_returns), 0)

    def _hit(self, view: View, limit: np.uint16, scan: np.uint8) -> int:
        fx, fy, cx, cy = view.pinhole
        R, resolution_m = view.T_map_camera[:3, :3], self._box.resolution_m
        per_raw = view.scale_m / resolution_m
        du, dv = R[:, 0] * per_raw / fx, R[:, 1] * per_raw / fy
        corner = R[:, 2] * per_raw - du * cx - dv * cy
        offset = (view.T_map_camera[:3, 3] - self._box.origin_m) / resolution_m
        hit, _, low, high = self._update
        row, total = 0, 0
        while True:
            row, count = hits.hit_pixels(
                self._store.bricks,
                view.depth,
                row,
                limit,
                du.astype(np.float32),
                dv.astype(np.float32),
                corner.astype(np.float32),
                offset.astype(np.float32),
                scan,
                hit,
                low,
                high,
            )
            total += int(count)
            if row == len(view.depth):
                return total
            self._store.grow()

    def _cull(self, view: View, scan: np.uint8) -> int:
        resolution_m = self._box.resolution_m
        R_camera_map = view.T_map_camera[:3, :3].T
        T = np.empty((3, 4), np.float32)
        T[:, :3] = R_camera_map * (BRICK * resolution_m)
        T[:, 3] = R_camera_map @ (self._box.origin_m - view.T_map_camera[:3, 3])
        half_m = np.abs(R_camera_map).sum(axis=1) * ((BRICK - 1) / 2 * resolution_m)
        count: int = carve.cull(
            self._store.bricks,
            T,
            half_m.astype(np.float32),
            np.asarray(view.pinhole, np.float32),
            np.asarray(view.depth.shape, np.int64),
            self._sight.tiles(),
            np.float32(FOOTPRINT * view.pinhole[0] * resolution_m),
            scan,
            self._update[2],
            np.float32(MARGIN * resolution_m),
            self._listed,
        )
        return count

    def _carve(self, view: View, count: int, scan: np.uint8) -> None:
        used = self._listed[3][:count][self._listed[1][:count] == carve.PART]
        sights = self._sight.levels(used)
        offsets = (view.T_map_camera[:3, :3].T @ self._voxels_m).astype(np.float32)
        _, miss, low, _ = self._update
        first = 0
        while True:
            first = carve.carve(
                self._store.bricks,
                first,
                count,
                self._listed,
                offsets,
                sights,
                np.asarray(view.pinhole, np.float32),
                np.asarray(view.depth.shape, np.int64),
                scan,
                miss,
                low,
                np.float32(MARGIN * self._box.resolution_m),
            )
            if first == count:
                return
            self._store.grow()
