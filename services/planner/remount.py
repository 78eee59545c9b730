"""From flying cameras to robots with wheels and back, without a jump of the references."""

from collections.abc import Sequence

import numpy as np

from services.kernels.rigid import FloatArray, optical_yaw, rotation_exp
from services.planner.ease import ease
from services.planner.motion import Motion
from services.planner.wheels import Carrier, Mounted, wrapped

DURATION_S = 1.0
"""Turns half a view, 0.7 rad, at no more than 1.3 rad/s: a camera may do 2.5."""


class Remount:
    """One carrier in the place of another: views turn from where one points them to the other's.

    Both leave place, height and tilt as they are, so that only the yaw differs. Until that is
    turned the cameras fly: no robot carries one that turns on it.
    """

    def __init__(self, before: Carrier, after: Carrier) -> None:
        self._before: Carrier | None = before
        self._after = after
        self._start_s: float | None = None

    def carry(
        self,
        cameras: Sequence[int],
        views: Sequence[Motion],
        target: Motion,
        t_s: float,
        psi_rad: FloatArray | None = None,
    ) -> tuple[Mounted, ...]:
        """Return what each camera is told; see `Carrier`."""
        new = self._after.carry(cameras, views, target, t_s, psi_rad)
        if self._start_s is None:
            self._start_s = t_s
        passed = (t_s - self._start_s) / DURATION_S
        if self._before is None or not 0.0 <= passed < 1.0:
            self._before = None
            return new
        old = self._before.carry(cameras, views, target, t_s, psi_rad)
        share, rate = ease(passed)
        return tuple(
            Mounted(_between(a.view, b.view, share, rate / DURATION_S), None)
            for a, b in zip(old, new, strict=True)
        )


def _between(old: Motion, new: Motion, share: float, rate: float) -> Motion:
    """Return the new view, turned back by what is left of the way from the old."""
    left, off_rad = 1.0 - share, wrapped(optical_yaw(old.T) - optical_yaw(new.T))
    T = new.T.copy()
    T[:3, :3] = rotation_exp([0.0, 0.0, left * off_rad]) @ T[:3, :3]
    turning = np.array([0.0, 0.0, rate * off_rad])
    return Motion(T, new.linear, new.angular + left * (old.angular - new.angular) - turning)
