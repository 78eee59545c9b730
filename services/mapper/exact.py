"""Fuse points ray by ray: the same class as OctoMap's `insertPointCloud`, voxel for voxel."""

import numpy as np
from numpy.typing import NDArray

from services.kernels import rays
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.sensor_model import SensorModel


class ExactIntegrator:
    """Fuses unorganised clouds into a store."""

    def __init__(self, box: Box, store: BrickStore, sensor: SensorModel) -> None:
        self._box, self._store = box, store
        self._update = sensor.fixed_point()
        self._first_key = np.asarray(box.first_key, np.int64)
        self._ends = np.empty((0, 3), np.float32)

    def fuse(
        self,
        points: NDArray[np.float32],
        origin: NDArray[np.float32],
        max_range_m: float,
        discretize: bool,
    ) -> tuple[int, int]:
        """Fuse checked points (N, 3), map frame, m; return voxels hit and points skipped."""
        if len(self._ends) < len(points):
            self._ends = np.empty((len(points), 3), np.float32)
        scan = self._store.begin_scan()
        num_rays, num_hits, num_skipped = self._hit(points, origin, max_range_m, discretize, scan)
        self._miss(num_rays, origin, scan)
        return num_hits, num_skipped

    def _hit(
        self,
        points: NDArray[np.float32],
        origin: NDArray[np.float32],
        max_range_m: float,
        discretize: bool,
        scan: np.uint8,
    ) -> tuple[int, int, int]:
        hit, _, low, high = self._update
        first, kept, num_hits, num_skipped = 0, 0, 0, 0
        while True:
            first, kept, added, skipped = rays.hit_points(
                self._store.bricks,
                points,
                origin,
                self._first_key,
                self._box.resolution_m,
                discretize,
                max_range_m,
                scan,
                hit,
                low,
                high,
                first,
                self._ends,
                kept,
            )
            num_hits, num_skipped = num_hits + added, num_skipped + skipped
            if first == len(points):
                return kept, num_hits, num_skipped
            self._store.grow()

    def _miss(self, num_rays: int, origin: NDArray[np.float32], scan: np.uint8) -> None:
        _, miss, low, high = self._update
        first = 0
        while True:
            first = rays.miss_rays(
                self._store.bricks,
                self._ends,
                first,
                num_rays,
                origin,
                self._first_key,
                self._box.resolution_m,
                scan,
                miss,
                low,
                high,
            )
            if first == num_rays:
                return
            self._store.grow()
