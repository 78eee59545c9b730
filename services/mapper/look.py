"""One depth image on its way into the map: what it hits, what it sees, what that frees."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels import carve, cull, hits
from services.kernels.bricks import BRICK, VOXELS, Bricks
from services.kernels.levels import NUM_LEVELS
from services.kernels.marks import WORDS
from services.mapper.box import Box
from services.mapper.sight import Sight, windows
from services.mapper.view import View

FOOTPRINT = 0.92
"""Window over a voxel's silhouette; fitted to OctoMap (benchmarks/mapping_agreement.py)."""
MARGIN = 0.3
"""Voxels that a return must lie behind a voxel's centre to free it; fitted likewise."""
_VOXELS = np.stack(np.unravel_index(np.arange(VOXELS), (BRICK,) * 3)) - (BRICK - 1) / 2
"""(3, 512) centres of a brick's voxels about its own, voxels."""
Update = tuple[int, int, int, int]
Listed = tuple[NDArray[np.int32], NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]


class Span(NamedTuple):
    """Bricks first .. end - 1 of the directory: who owns them may write them."""

    first: int
    end: int


class Look:
    """Buffers for one image at a time over a box of `num_bricks` bricks.

    The steps `locate` and `list_bricks` read the map, so that many images can take them at once;
    `apply` writes it, and only in the span it is given.
    """

    def __init__(self, num_bricks: int) -> None:
        self._flags = np.zeros(num_bricks, np.uint8)
        self._number = np.empty(num_bricks, np.int32)
        self._hit_bricks = np.empty(0, np.int32)
        self._marks = np.empty((0, WORDS), np.uint64)
        self._listed = _lists(0)
        self._addresses = np.empty(1, np.int32)
        self._sight = Sight(1, 1)
        self._num_listed = 0

    @property
    def num_bytes(self) -> int:
        """Bytes held for the bricks of the box and the last image."""
        return sum(array.nbytes for array in self._arrays())

    def locate(self, view: View, box: Box) -> None:
        """Take a checked image in: the voxels that its pixels end in, and how far it sees."""
        self._view, self._box = view, box
        if view.depth.shape != self._sight.shape:
            self._sight = Sight(*view.depth.shape)
            self._addresses = np.empty(view.depth.size + 1, np.int32)
        count = hits.locate_pixels(
            view.depth,
            view.limit,
            *view.pixels_in(box),
            np.asarray(box.shape, np.int32),
            self._addresses,
        )
        addresses = self._addresses[:count]
        listed = np.empty(min(count, len(self._flags)), np.int32)
        count = hits.number_bricks(addresses, cull.HIT, self._flags, self._number, listed)
        self._hit_bricks = listed[:count]
        self._marks = np.zeros((count, WORDS), np.uint64)
        hits.mark_voxels(addresses, self._number, self._marks)
        self._sight.look(view.depth, view.limit)

    def heed(self, other: "Look") -> None:
        """Know of the bricks that another image of the same instant ends in."""
        self._flags[other._hit_bricks] |= cull.HIT_BY_ANY

    def list_bricks(self, bricks: Bricks, low: int) -> None:
        """Find the bricks that the image says anything about."""
        view, resolution_m = self._view, self._box.resolution_m
        R_camera_map = view.T_map_camera[:3, :3].T
        T = np.empty((3, 4), np.float32)
        T[:, :3] = R_camera_map * (BRICK * resolution_m)
        T[:, 3] = R_camera_map @ (self._box.origin_m - view.T_map_camera[:3, 3])
        half_m = np.abs(R_camera_map).sum(axis=1) * ((BRICK - 1) / 2 * resolution_m)
        # A cube's silhouette: its extent along u and v, and its area, in edges.
        along_u, along_v, area = np.abs(R_camera_map).sum(axis=1)
        fx, fy, _, _ = view.pinhole
        wide, side_m = math.sqrt(along_u / along_v), FOOTPRINT * math.sqrt(area) * resolution_m
        self._edge = np.array([side_m * wide, side_m / wide], np.float32)
        aspect = wide * math.sqrt(fx / fy)  # of a window, in pixels.
        spans, sizes = np.empty((NUM_LEVELS, 4), np.int32), windows(aspect)
        seen = (
            T,
            half_m.astype(np.float32),
            np.asarray(view.pinhole, np.float32),
            np.asarray(view.depth.shape, np.int64),
            self._sight.tables(),
            sizes,
            np.float32(view.scale_m),
            np.float32(side_m * math.sqrt(fx * fy)),
            low,
            np.float32(MARGIN * resolution_m),
            self._flags,
            spans,
        )
        self._num_listed = cull.cull(bricks, *seen, self._listed)
        if self._num_listed > len(self._listed[0]):
            self._listed = _lists(self._num_listed * 5 // 4)
            cull.cull(bricks, *seen, self._listed)
        self._sights = self._sight.levels(spans, sizes)
        self._offsets = (R_camera_map @ (_VOXELS * resolution_m)).astype(np.float32)

    def slots_needed(self, bricks: Bricks, span: Span) -> int:
        """Return how many bricks of a span may be opened."""
        which, kinds, _, _ = self._listed
        parts = which[: self._num_listed][kinds[: self._num_listed] == cull.PART]
        listed = carve.count_closed(bricks, parts, *span)
        return int(listed + carve.count_closed(bricks, self._hit_bricks, *span))

    def apply(self, bricks: Bricks, span: Span, update: Update) -> int:
        """Hit and free the voxels of a span; return how many were hit."""
        num_hits: int = hits.hit_bricks(bricks, self._hit_bricks, self._marks, *span, update)
        first, end = np.searchsorted(self._listed[0][: self._num_listed], span)
        carve.carve(
            bricks,
            tuple(part[first:end] for part in self._listed),
            self._offsets,
            self._sights,
            np.asarray(self._view.pinhole, np.float32),
            np.asarray(self._view.depth.shape, np.int64),
            self._edge,
            np.array([1.0, MARGIN * self._box.resolution_m], np.float32)
            / np.float32(self._view.scale_m),
            self._flags,
            self._number,
            self._marks,
            update,
        )
        return num_hits

    def forget(self) -> None:
        """Be ready for the next image."""
        self._flags.fill(0)

    def _arrays(self) -> tuple[NDArray[np.generic], ...]:
        scratch = (self._flags, self._number, self._hit_bricks, self._addresses, self._marks)
        return (*scratch, *self._listed, *self._sight.arrays())


def _lists(num_bricks: int) -> Listed:
    return (
        np.empty(num_bricks, np.int32),
        np.empty(num_bricks, np.uint8),
        np.empty((num_bricks, 3), np.float32),
        np.empty(num_bricks, np.int32),
    )
