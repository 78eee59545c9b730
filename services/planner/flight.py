"""A camera's smooth flight from view to view, with a rest at each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray, rotation_exp, rotation_log
from services.planner.motion import Motion, still

_NO_ARM_M = 1e-9
"""A view this near to the centre has no direction from it."""


@dataclass(frozen=True)
class Flight:
    """Round trip through views: rest `dwell_s` at each, fly `travel_s` to the next."""

    views: Sequence[FloatArray]
    """(4, 4) each, one common frame from the optical frame."""
    centre_m: FloatArray
    """(3,) the legs are arcs around it, so that the camera does not fly through the object."""
    dwell_s: float
    travel_s: float

    def at(self, t_s: float) -> Motion:
        """Return the view and its twist at `t_s`; velocity and acceleration are continuous."""
        leg_s = self.dwell_s + self.travel_s
        leg, into_s = divmod(max(t_s, 0.0), leg_s)
        start = self.views[int(leg) % len(self.views)]
        end = self.views[(int(leg) + 1) % len(self.views)]
        if into_s <= self.dwell_s:
            return still(start)
        s, rate = _ease((into_s - self.dwell_s) / self.travel_s)
        return _between(start, end, self.centre_m, s, rate / self.travel_s)


def _ease(x: float) -> tuple[float, float]:
    """Return minimum-jerk progress and its derivative. Source: Flash & Hogan, 1985."""
    return x**3 * (10 - 15 * x + 6 * x * x), 30 * x * x * (1 - x) ** 2


def _between(
    start: FloatArray, end: FloatArray, centre: FloatArray, s: float, rate: float
) -> Motion:
    """Return the view at share `s` of a leg, moving at `rate` shares per second."""
    turn = rotation_log(end[:3, :3] @ start[:3, :3].T)
    position, slope = _arc(start[:3, 3] - centre, end[:3, 3] - centre, s)
    T = np.eye(4)
    T[:3, :3] = rotation_exp(s * turn) @ start[:3, :3]
    T[:3, 3] = centre + position
    return Motion(T, rate * slope, rate * turn)


def _arc(a: FloatArray, b: FloatArray, s: float) -> tuple[FloatArray, FloatArray]:
    """Go from arm `a` to arm `b`: direction along the great circle, length evenly.

    Returns:
        (3,) the arm at share `s`, and its derivative by `s`.
    """
    length_a, length_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(length_a, length_b) < _NO_ARM_M:
        return a + s * (b - a), b - a
    swing = _swing(a / length_a, b / length_b)
    length, growth = length_a + s * (length_b - length_a), length_b - length_a
    direction = rotation_exp(s * swing) @ a / length_a
    return length * direction, growth * direction + length * np.cross(swing, direction)


def _swing(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the shortest rotation vector from unit `a` to unit `b`."""
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:  # Same or opposite; any axis square to `a` goes to the opposite.
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        angle = 0.0 if a @ b > 0 else np.pi
    else:
        angle = float(np.arctan2(sine, a @ b))
    swing: FloatArray = axis / np.linalg.norm(axis) * angle
    return swing
