"""What the mapper tells about an instant: the messages, from the map and the instant at hand."""

import math
from typing import Any

import numpy as np

from schemas.geometry import Pose
from schemas.map import MapChanges, MapFull, MapSummary
from schemas.message import ArrayMessage
from services.mapper.barrier import Close
from services.mapper.box import Box
from services.mapper.errors import MapTooLarge
from services.mapper.fusion import Fusion
from services.mapper.placement import Frame


def rows_of(kind: type[ArrayMessage]) -> int:
    """Return how many rows the array of a message may have at most."""
    layout = kind.LAYOUT
    width = math.prod(count for count in layout.shape if count is not None)
    return layout.max_bytes // (width * np.dtype(layout.dtype).itemsize)


MAX_ROWS = rows_of(MapChanges)
"""Changed voxels of one revision; the rest is told with the next."""
MAX_BRICKS = rows_of(MapFull)
"""Bricks of one snapshot."""


def check_told(box: Box) -> None:
    """See to it that a snapshot can tell all of a box.

    Raises:
        MapTooLarge: If it would exceed what a message may hold.
    """
    if math.prod(box.num_bricks) > MAX_BRICKS:
        raise MapTooLarge(
            f"box of {box.shape} voxels has {math.prod(box.num_bricks)} bricks; map/full holds "
            f"at most {MAX_BRICKS}, {MAX_BRICKS * 512 / 1e6:.0f} million voxels: choose a "
            f"smaller box or voxels larger than {box.resolution_m} m"
        )


class Reporter:
    """Numbers the revisions and builds their messages.

    Raises:
        MapTooLarge: If a snapshot of the whole box would exceed what a message may hold.
    """

    def __init__(
        self, fusion: Fusion, frame: Frame, entropy_every: int, max_rows: int = MAX_ROWS
    ) -> None:
        check_told(fusion.voxel_map.box)
        self._fusion, self._frame, self._entropy_every = fusion, frame, entropy_every
        self._max_rows = max_rows
        self.rev = 0
        self._base_rev = 0
        """The revision that the next changes lead on from; 0 is the empty map."""
        self._stamp: dict[str, Any] = {"t_ns": 0, "tick": 0}
        self._head = self._headed()
        self._num_changed = 0

    def changes(self, tick: int, t_ns: int) -> MapChanges:
        """Begin the next revision: what changed since the last."""
        rows = self._fusion.voxel_map.changes(self._max_rows)
        self._stamp, self._num_changed = {"t_ns": t_ns, "tick": tick}, len(rows)
        self.rev += 1
        self._head = self._headed()
        base_rev, self._base_rev = self._base_rev, self.rev
        return MapChanges.of(rows, base_rev=base_rev, **self._head)

    def begin_anew(self) -> None:
        """The map is another one: the next changes tell all of it."""
        self._base_rev = 0

    @property
    def tick(self) -> int:
        """The instant of the last changes."""
        return int(self._stamp["tick"])

    def full(self) -> MapFull:
        """Return the map, and where it was, as the last changes left it."""
        _, index, log_odds = self._fusion.voxel_map.snapshot()
        return MapFull.of(np.concatenate([index, log_odds], axis=1), **self._head)

    def summary(self, close: Close, latency_ms: float, num_late: int) -> MapSummary:
        """Return one line about the revision."""
        fusion, every = self._fusion, self._entropy_every
        counts = fusion.voxel_map.counts()
        wants_entropy = every > 0 and (self.rev - 1) % every == 0
        not_fused = tuple(camera for camera in close.used if camera not in fusion.used)
        return MapSummary(
            **self._stamp,
            frame_id=self._frame,
            rev=self.rev,
            cameras_used=fusion.used,
            cameras_missing=tuple(sorted((*close.missing, *not_fused))),
            num_returns=fusion.num_returns,
            num_occupied=counts.occupied,
            num_free=counts.free,
            num_changed=self._num_changed,
            fuse_ms=fusion.fuse_s * 1e3,
            latency_ms=latency_ms,
            entropy_bits=fusion.voxel_map.entropy_bits() if wants_entropy else None,
            late_clouds=num_late,
            memory=fusion.memory.memory,
            origin=self._head["origin"],
            archived_bricks=fusion.voxel_map.num_archived,
            num_dynamic=fusion.voxel_map.num_dynamic,
        )

    def _headed(self) -> dict[str, Any]:
        box = self._fusion.voxel_map.box
        x, y, z = (float(value) for value in box.origin_m)
        return {
            **self._stamp,
            "frame_id": self._frame,
            "rev": self.rev,
            "resolution_m": box.resolution_m,
            "origin": (x, y, z),
            "shape_voxels": box.shape,
            "pose": Pose.from_matrix(self._fusion.T_world_map),
        }
