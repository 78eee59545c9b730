"""What the mapper tells about an instant: the messages, from the map and the instant at hand."""

from typing import Any

import numpy as np

from schemas.geometry import Pose
from schemas.map import MapChanges, MapFull, MapSummary
from services.mapper.barrier import Close
from services.mapper.fusion import Frame, Fusion


class Reporter:
    """Numbers the revisions and builds their messages."""

    def __init__(self, fusion: Fusion, frame: Frame, entropy_every: int) -> None:
        self._fusion, self._frame, self._entropy_every = fusion, frame, entropy_every
        self.rev = 0
        self._stamp: dict[str, Any] = {"t_ns": 0, "tick": 0}
        self._num_changed = 0

    def changes(self, tick: int, t_ns: int) -> MapChanges:
        """Begin the next revision: what changed since the last."""
        rows = self._fusion.voxel_map.changes()
        self._stamp, self._num_changed = {"t_ns": t_ns, "tick": tick}, len(rows)
        self.rev += 1
        return MapChanges.of(rows, base_rev=self.rev - 1, **self._head())

    def full(self) -> MapFull:
        """Return the map as the last changes left it."""
        index, log_odds = self._fusion.voxel_map.published_bricks()
        return MapFull.of(np.concatenate([index, log_odds], axis=1), **self._head())

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
        )

    def _head(self) -> dict[str, Any]:
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
