"""Where the target has been."""

import math
from collections import deque

import numpy as np

from services.kernels.rigid import FloatArray, apply, inverse
from services.viewer.colours import Rgb
from services.viewer.primitives import Lines

TRAIL_S = 5.0
_MAX_POINTS = 1024
_TRAIL_POINTS = 50
_FINEST_M = 0.02
_ABOVE_PATH_M = 0.003  # Else path and trail flicker through each other.
_PATH_COLOUR: Rgb = (150, 150, 150)
_TRAIL_COLOUR: Rgb = (230, 90, 40)


class Trail:
    """The whole path, coarser the longer it is, and its last seconds; memory is bounded."""

    def __init__(self, span_s: float = TRAIL_S) -> None:
        self._span_s = span_s
        self._recent: deque[tuple[float, FloatArray]] = deque(maxlen=_MAX_POINTS)
        self._path: list[FloatArray] = []
        self._spacing_m = _FINEST_M

    def add(self, t_s: float, position_m: FloatArray) -> None:
        """Note where the target is; a time before the last one is a new run."""
        if not (math.isfinite(t_s) and np.isfinite(position_m).all()):
            return
        if self._recent and t_s < self._recent[-1][0]:
            self._recent.clear()
            self._path, self._spacing_m = [], _FINEST_M
        point = np.array(position_m, np.float64)
        self._recent.append((t_s, point))
        while self._recent[0][0] < t_s - self._span_s:
            self._recent.popleft()
        if not self._path or np.linalg.norm(point - self._path[-1]) >= self._spacing_m:
            self._path.append(point)
        if len(self._path) > _MAX_POINTS:
            self._path, self._spacing_m = self._path[::2], 2 * self._spacing_m

    def path(self, above_m: float) -> Lines | None:
        """Return all of the path, so far above the ground, in the world; None before it moved."""
        segments = _joined(self._path, above_m)
        if not len(segments):
            return None
        grey = np.broadcast_to(np.asarray(_PATH_COLOUR, np.uint8), segments.shape)
        return Lines(segments.astype(np.float32), grey, np.eye(4))

    def recent(self, above_m: float, T_world_target: FloatArray) -> Lines | None:
        """Return the last seconds, brighter the newer, in the target's frame."""
        if len(self._recent) < 2:
            return None
        times = np.array([t_s for t_s, _ in self._recent])
        line = np.array([point for _, point in self._recent])
        # Always as many, so that a browser need not be told their colours again.
        at = np.linspace(times[0], times[-1], _TRAIL_POINTS)
        smooth = [np.array([np.interp(t_s, times, axis) for axis in line.T]) for t_s in at]
        segments = _joined(smooth, above_m + _ABOVE_PATH_M)
        share = np.linspace(0, 1, _TRAIL_POINTS)[:, None]
        fading = np.asarray(_PATH_COLOUR) * (1 - share) + np.asarray(_TRAIL_COLOUR) * share
        colours = np.stack([fading[:-1], fading[1:]], axis=1).astype(np.uint8)
        inside = apply(inverse(T_world_target), segments.reshape(-1, 3)).reshape(-1, 2, 3)
        return Lines(inside.astype(np.float32), colours, T_world_target)


def _joined(points: list[FloatArray], above_m: float) -> FloatArray:
    """(N - 1, 2, 3) segments from point to point."""
    if len(points) < 2:
        return np.empty((0, 2, 3))
    line = np.stack(points) + np.array([0.0, 0.0, above_m])
    return np.stack([line[:-1], line[1:]], axis=1)
