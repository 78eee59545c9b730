"""A camera's smooth flight from view to view, with a rest at each."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.planner.ease import ease
from services.planner.motion import Motion
from services.planner.rotations import exps, logs

_NO_ARM_M = 1e-9
"""A view this near to the centre has no direction from it."""
_NO_SINE = 1e-9
"""Arms whose directions differ by less are the same, or opposite."""


class Flight:
    """Round trip through views: rest `dwell_s` at each, fly `travel_s` to the next.

    The legs are arcs around the centre, so that the camera does not fly through the object.
    """

    def __init__(
        self, views: Sequence[FloatArray], centre_m: FloatArray, dwell_s: float, travel_s: float
    ) -> None:
        """Work out the legs.

        Args:
            views: (4, 4) each, one common frame from the optical frame.
            centre_m: (3,) of the arcs.
            dwell_s: rest at each view.
            travel_s: from one to the next.
        """
        self._dwell_s, self._travel_s = dwell_s, travel_s
        self._views, self._centre = np.array(views, np.float64), np.asarray(centre_m, np.float64)
        R = self._views[:, :3, :3]
        self._turns = logs(np.roll(R, -1, axis=0) @ np.swapaxes(R, 1, 2))
        self._arms = self._views[:, :3, 3] - self._centre
        self._lengths = np.linalg.norm(self._arms, axis=1)
        has_arm = self._lengths >= _NO_ARM_M
        self._bent = has_arm & np.roll(has_arm, -1)
        directions = self._arms / np.maximum(self._lengths, _NO_ARM_M)[:, None]
        self._directions, self._swings = directions, _swings(directions)

    def at(self, t_s: float) -> Motion:
        """Return the view and its twist at `t_s`; velocity and acceleration are continuous."""
        return self.all_at(np.array([t_s])).each()[0]

    def all_at(self, t_s: FloatArray) -> Motion:
        """Return the views and their twists at (N,) times."""
        leg_s, num = self._dwell_s + self._travel_s, len(self._views)
        legs, into_s = np.divmod(np.maximum(t_s, 0.0), leg_s)
        leg = legs.astype(np.int64) % num
        share, rate = ease(np.maximum(into_s - self._dwell_s, 0.0) / self._travel_s)
        s, s_dot = share[:, None], rate[:, None] / self._travel_s
        arm, slope = self._arc(leg, s)
        T = self._views[leg]
        T[:, :3, :3] = exps(s * self._turns[leg]) @ T[:, :3, :3]
        T[:, :3, 3] = self._centre + arm
        resting = s_dot[:, 0] == 0.0
        T[resting] = self._views[leg[resting]]  # To the last digit.
        return Motion(T, s_dot * slope, s_dot * self._turns[leg])

    def _arc(self, leg: NDArray[np.int64], s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Go along legs: direction along the great circle, length evenly.

        Returns:
            (N, 3) the arms at shares (N, 1), and their derivatives by the share.
        """
        following = (leg + 1) % len(self._views)
        a, b = self._arms[leg], self._arms[following]
        length_a, length_b = self._lengths[leg, None], self._lengths[following, None]
        swing, growth = self._swings[leg], length_b - length_a
        direction = np.einsum("nij,nj->ni", exps(s * swing), self._directions[leg])
        length = length_a + s * growth
        slope = growth * direction + length * np.cross(swing, direction)
        bent = self._bent[leg, None]
        return np.where(bent, length * direction, a + s * (b - a)), np.where(bent, slope, b - a)


def _swings(directions: FloatArray) -> FloatArray:
    """Return (N, 3) the shortest rotation vectors from each unit vector to the next in turn."""
    following = np.roll(directions, -1, axis=0)
    axis, cosine = np.cross(directions, following), np.sum(directions * following, axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, cosine)
    # Same or opposite; any axis square to the direction leads to the opposite.
    lost = sine < _NO_SINE
    axis[lost] = np.cross(directions[lost], np.eye(3)[np.argmin(np.abs(directions[lost]), axis=1)])
    angle[lost] = np.where(cosine[lost] > 0, 0.0, np.pi)
    length = np.maximum(np.linalg.norm(axis, axis=1), _NO_ARM_M)
    swings: FloatArray = axis * (angle / length)[:, None]
    return swings
