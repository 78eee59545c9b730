"""Where the target was at the instants whose clouds are still to be fused."""

import numpy as np
from numpy.typing import NDArray

from schemas.target import TargetPose
from services.kernels.rigid import integrate_twist

_KEPT = 64
"""Poses remembered: four seconds, far more than a barrier waits."""


_FAR_TICKS = 128
"""A cloud of a tick farther off belongs to another run, or to a sensor with a clock of its own."""
_FAR_S = 1.0
"""A twist is not carried farther than this."""


class TargetTrack:
    """Poses of the target by tick."""

    def __init__(self) -> None:
        self._poses: dict[int, TargetPose] = {}
        self._newest = -1

    def add(self, pose: TargetPose) -> None:
        """Remember a pose; one that goes back in time begins a new run."""
        if pose.tick < self._newest:
            self._poses.clear()
        self._newest = pose.tick
        self._poses[pose.tick] = pose
        while len(self._poses) > _KEPT:
            del self._poses[next(iter(self._poses))]

    def is_far_from(self, tick: int) -> bool:
        """Whether a tick is so far from the newest pose's that its clock must be another."""
        return self._newest >= 0 and abs(tick - self._newest) > _FAR_TICKS

    def at(self, tick: int, t_ns: int, guess: bool = False) -> NDArray[np.float64] | None:
        """Return T_world_target at a tick.

        A pose that was passed over is carried there from the nearest by its twist.

        Args:
            tick: which instant. t_ns: its time.
            guess: carry the newest pose forward instead of waiting for the tick's own.

        Returns:
            None if the tick's own pose may still come, or nothing is known.
        """
        if (own := self._poses.get(tick)) is not None:
            return own.pose.matrix()
        if not self._poses or (tick > self._newest and not guess):
            return None
        nearest = min(self._poses.values(), key=lambda pose: abs(pose.t_ns - t_ns))
        dt_s = (t_ns - nearest.t_ns) * 1e-9
        if abs(dt_s) > _FAR_S:
            return None
        linear, angular = np.asarray(nearest.twist.linear), np.asarray(nearest.twist.angular)
        return integrate_twist(nearest.pose.matrix(), linear, angular, dt_s)
