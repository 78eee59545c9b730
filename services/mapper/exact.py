"""Fuse points ray by ray: the same class as OctoMap's `insertPointCloud`, voxel for voxel."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from services.kernels import ends, marks, rays
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.sensor_model import SensorModel

_CHUNK = 4096
"""Points located at a time: what is written of them stays in the cache."""


class ExactIntegrator:
    """Fuses unorganised clouds into a store."""

    def __init__(self, box: Box, store: BrickStore, sensor: SensorModel) -> None:
        self._box, self._store, self._sensor = box, store, sensor
        # A bit per voxel of the box, from the first cloud on; misses for every thread.
        self._hits = np.empty(0, np.uint64)
        self._misses: list[NDArray[np.uint64]] = []
        self._ends = np.empty((3, 0), np.float32)

    def move_to(self, box: Box) -> None:
        """Go on in a box that has moved by whole bricks."""
        self._box = box

    @property
    def num_bytes(self) -> int:
        """Bytes of marks and rays."""
        return self._ends.nbytes + sum(m.nbytes for m in (self._hits, *self._misses))

    def fuse(
        self,
        points: NDArray[np.float32],
        origin: NDArray[np.float32],
        max_range_m: float,
        discretize: bool,
        threads: int = 1,
    ) -> tuple[int, int]:
        """Fuse checked points (N, 3), map frame, m; return voxels hit and points skipped."""
        self._reserve_marks(threads)
        try:
            num_rays, num_hits, num_skipped = self._end(points, origin, max_range_m, discretize)
            self._walk(num_rays, origin, threads)
            self._take_in()
        except BaseException:
            # Interrupted: no mark may stay for the next cloud.
            for left in (self._hits, *self._misses):
                left.fill(0)
            raise
        return num_hits, num_skipped

    def _end(
        self,
        points: NDArray[np.float32],
        origin: NDArray[np.float32],
        max_range_m: float,
        discretize: bool,
    ) -> tuple[int, int, int]:
        """Mark the voxels that points end in; list the ends of the rays to walk."""
        if self._ends.shape[1] < len(points):
            self._ends = np.empty((3, len(points)), np.float32)
        key0, shape, resolution_m = self._grid()
        located, address = np.empty((3, _CHUNK), np.float32), np.empty(_CHUNK, np.int32)
        kept, num_hits, num_skipped = 0, 0, 0
        for first in range(0, len(points), _CHUNK):
            some = points[first : first + _CHUNK]
            there = address[: len(some)]
            ends.columns(some, located)
            ends.round_ends(located, origin, resolution_m, discretize, max_range_m, there)
            ends.address_ends(located, key0, shape, resolution_m, there)
            kept, added, skipped = ends.mark_ends(
                self._hits, located, there, origin, max_range_m, discretize, self._ends, kept
            )
            num_hits, num_skipped = num_hits + added, num_skipped + skipped
        return kept, num_hits, num_skipped

    def _walk(self, num_rays: int, origin: NDArray[np.float32], threads: int) -> None:
        """Mark the voxels that rays cross; each thread has marks of its own."""
        order = np.empty(num_rays, np.int32)
        longest = sum(self._box.shape)
        # All that there is room for, used or not: a part of it has another memory layout, for which
        # numba would compile anew in the middle of an instant.
        rays.sort_by_length(self._ends, origin, self._box.resolution_m, longest, order)

        def walk(part: int) -> None:
            mine = np.ascontiguousarray(order[part::threads])
            rays.mark_rays(self._misses[part], self._ends, mine, origin, *self._grid())

        if threads == 1:
            walk(0)
            return
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(walk, range(threads)))
        for other in self._misses[1:threads]:
            marks.merge(self._misses[0], other)

    def _take_in(self) -> None:
        """Update the marked voxels."""
        update = self._sensor.fixed_point()
        marks.take_in(self._store.bricks, self._hits, self._misses[0], update)

    def _grid(self) -> tuple[NDArray[np.int64], NDArray[np.int64], float]:
        """First key, voxels along the axes, m per voxel."""
        box = self._box
        return np.asarray(box.first_key, np.int64), np.asarray(box.shape), box.resolution_m

    def _reserve_marks(self, threads: int) -> None:
        num_words = self._store.bricks.slot.size * marks.WORDS
        if not len(self._hits):
            self._hits = np.zeros(num_words, np.uint64)
        while len(self._misses) < threads:
            self._misses.append(np.zeros(num_words, np.uint64))
