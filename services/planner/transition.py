"""From one formation to another without a jump, in the frame of the target."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.planner.course import Course
from services.planner.detours import detours
from services.planner.ease import ease
from services.planner.here import Here
from services.planner.motion import Motion
from services.planner.overhead import Overhead
from services.planner.pace import INSTANTS, SHARES, Pace, Ways, time_needed
from services.planner.planar import wrapped
from services.planner.rotations import exps, left_jacobians, logs
from services.planner.source import Source
from services.planner.spherical import Spherical

_SHORTEST_S, _LONGEST_S = 0.3, 120.0
_ROUNDS, _SLACK = 4, 1.02
"""Ends that move are elsewhere when the change takes longer: then it is looked at again."""
_SAME_ROTATION = 1e-9
_STEEP_RAD = np.radians(65.0)
"""A camera that the centre sees higher is led over the target, not around it."""
_FARTHEST_TURN_RAD = 1.6 * np.pi
"""A turn is followed past pi, so that it does not flip; not to 2 pi, where it has no rate."""


class Transition:
    """Minimum jerk from what was planned to what is now, while both go on moving.

    With s from 0 to 1, each coordinate is (1 - s) before + s after; its rate is the exact
    derivative, so that position, heading and both velocities are continuous. Overhead, where
    azimuth jumps, the coordinates are tilts from the zenith; which a camera has stays the same.
    """

    def __init__(
        self,
        before: Source,
        after: Source,
        here: Here,
        pace: Pace,
        safe_m: float,
    ) -> None:
        """Plan the change.

        Args:
            before: what the same cameras followed until now.
            after: what they shall follow.
            here: when the change begins.
            pace: that no camera exceeds.
            safe_m: distance that cameras keep.
        """
        self.cameras = after.cameras
        self.before, self.after = before, after
        self._here, self._centre, self._start_s = here, here.centre_m, here.t_s
        self._phi: FloatArray | None = None
        self._turn: FloatArray | None = None
        self._out_m, self._duration_s = np.zeros(len(self.cameras)), _SHORTEST_S
        self._over = np.zeros(len(self.cameras), np.bool_)
        if not self.cameras:
            return
        ways = self._ways(INSTANTS[:1])  # As if both ends were at rest.
        self._turn = ways.turn_rad[0]
        self._lengthen(time_needed(ways, 0.0, self._out_m, self._roll(), pace))
        for _ in range(_ROUNDS):
            ways = self._ways(INSTANTS * self._duration_s)
            self._out_m = self._detours(ways, safe_m)
            needed_s = time_needed(ways, self._duration_s, self._out_m, self._roll(), pace)
            if needed_s <= _SLACK * self._duration_s:
                return
            self._lengthen(needed_s)
            if ways.at_rest:
                return
        ways = self._ways(INSTANTS * self._duration_s)
        self._out_m = self._detours(ways, safe_m)

    def _detours(self, ways: Ways, safe_m: float) -> FloatArray:
        return detours(ways.at(SHARES, 0 * self._out_m), SHARES, safe_m, self._over)

    def _lengthen(self, needed_s: float) -> None:
        self._duration_s = min(max(needed_s, self._duration_s), _LONGEST_S)

    def done(self, t_s: float) -> bool:
        """Whether nothing of the old plan is left."""
        return t_s >= self._start_s + self._duration_s

    def at(self, target: Motion, t_s: float) -> Motion:
        """Return the references at `t_s`, frame of the target."""
        after = self.after.at(target, t_s)
        if self.done(t_s):
            return after
        share, rate = ease(max(0.0, t_s - self._start_s) / self._duration_s)
        return self._blend(self.before.at(target, t_s), after, share, rate / self._duration_s)

    def _blend(self, before: Motion, after: Motion, share: float, rate: float) -> Motion:
        a, b = Spherical.of(before, self._centre), Spherical.of(after, self._centre)
        start, end = Course.of(a), Course.of(b)
        # Around the target by the side chosen first, however far both have gone on since.
        turn = wrapped(end.theta_rad - start.theta_rad)
        last = turn if self._turn is None else self._turn
        self._turn = turn + 2 * np.pi * np.round((last - turn) / (2 * np.pi))
        span = np.stack([end.range_m - start.range_m, self._turn, end.climb_m - start.climb_m])
        from_dot, to_dot = _array(Course.rates_of(a)), _array(Course.rates_of(b))
        now = _array(start) + share * span
        now_dot = from_dot + share * (to_dot - from_dot) + rate * span
        out_m = 4 * share * (1 - share) * self._out_m
        out_dot = 4 * (1 - 2 * share) * rate * self._out_m
        now[0] += out_m
        now_dot[0] += out_dot
        gazing = Course(*now).places(Course(*now_dot)).gazing(self._centre)
        if np.any(self._over):
            above, end_above = (Overhead.of(each, self._centre) for each in (before, after))
            way = above.towards(end_above, share, rate).farther(out_m, out_dot)
            gazing = _mixed(gazing, self._over, way.tilted(self._centre))
        return self._turned(
            gazing,
            _off_centre(before, self._facing(before, a)),
            _off_centre(after, self._facing(after, b)),
            share,
            rate,
        )

    def _facing(self, views: Motion, places: Spherical) -> Motion:
        """Return frames where these views are that are turned by where that is alone."""
        gazing = places.gazing(self._centre)
        if not np.any(self._over):
            return gazing
        tilted = Overhead.of(views, self._centre).tilted(self._centre)
        return _mixed(gazing, self._over, tilted)

    def _turned(
        self, gazing: Motion, before: Motion, after: Motion, share: float, rate: float
    ) -> Motion:
        """Turn views from the centre as far as old and new ones look past it.

        E = E_a exp(s phi), exp(phi) = E_a' E_b; rates by the left Jacobian of SO(3).
        """
        off = np.abs(before.T[:, :3, :3] - np.eye(3)).max(axis=(1, 2))
        off = np.maximum(off, np.abs(after.T[:, :3, :3] - np.eye(3)).max(axis=(1, 2)))
        if not np.any(off > _SAME_ROTATION):
            return gazing
        E_a, E_b = before.T[:, :3, :3], after.T[:, :3, :3]
        back = np.swapaxes(E_a, 1, 2)
        phi = self._followed(logs(back @ E_b))
        relative = _times(back, after.angular - before.angular)
        phi_dot = np.linalg.solve(left_jacobians(phi), relative[..., None])[..., 0]
        spin = _times(left_jacobians(share * phi), rate * phi + share * phi_dot)
        R = gazing.T[:, :3, :3]
        T = gazing.T.copy()
        T[:, :3, :3] = R @ E_a @ exps(share * phi)
        angular = gazing.angular + _times(R, before.angular + _times(E_a, spin))
        return Motion(T, gazing.linear, angular)

    def _followed(self, phi: FloatArray) -> FloatArray:
        """Return each turn, or the same one the other way around: what is nearer to the last."""
        angle = np.linalg.norm(phi, axis=1)[:, None]
        other = phi * (1 - 2 * np.pi / np.maximum(angle, 1e-9))
        last = phi if self._phi is None else self._phi
        nearer = np.linalg.norm(other - last, axis=1) < np.linalg.norm(phi - last, axis=1)
        nearer &= 2 * np.pi - angle[:, 0] < _FARTHEST_TURN_RAD
        self._phi = np.where(nearer[:, None], other, phi)
        return self._phi

    def eyes(self, targets: Sequence[Motion], times_s: Sequence[float]) -> FloatArray:
        """Return (S, N, 3) where the cameras will be; see `Source`."""
        after = self.after.eyes(targets, times_s)
        if self.done(times_s[0]):
            return after
        passed = (np.asarray(times_s) - self._start_s) / self._duration_s
        share, _ = ease(np.clip(passed, 0.0, 1.0))
        start, end = (
            Course.to(each - self._centre) for each in (self.before.eyes(targets, times_s), after)
        )
        ways = Ways(start, end, self._unwound(start, end), self._over)
        arms = ways.at(share, self._out_m).arms_m()
        return np.where(share[:, None, None] < 1.0, self._centre + arms, after)

    def _ways(self, delays_s: FloatArray) -> Ways:
        """Look ahead: where both ends are so much after the beginning."""
        start, end = (
            self._here.courses(each, delays_s.tolist()) for each in (self.before, self.after)
        )
        steepest = np.maximum(start.elevation_rad, end.elevation_rad).max(axis=0)
        self._over |= steepest > _STEEP_RAD
        spin_rps = float(np.linalg.norm(self._here.target.angular))
        return Ways(start, end, self._unwound(start, end), self._over, spin_rps)

    def _unwound(self, start: Course, end: Course) -> FloatArray:
        """Return (S, N) the turns from start to end, each by the side chosen first."""
        turn = np.unwrap(wrapped(end.theta_rad - start.theta_rad), axis=0)
        last = turn[0] if self._turn is None else self._turn
        unwound: FloatArray = turn + 2 * np.pi * np.round((last - turn[0]) / (2 * np.pi))
        return unwound

    def _roll(self) -> FloatArray:
        """Return (N,) how far the ends' views are turned against each other, past the centre."""
        views = (each.at(self._here.target, self._start_s) for each in (self.before, self.after))
        E_a, E_b = (
            _off_centre(view, self._facing(view, Spherical.of(view, self._centre))).T[:, :3, :3]
            for view in views
        )
        roll: FloatArray = np.linalg.norm(logs(np.swapaxes(E_a, 1, 2) @ E_b), axis=1)
        return roll


def _mixed(motions: Motion, those: NDArray[np.bool_], other: Motion) -> Motion:
    """Return N frames, but the others for those of the (N,) cameras."""
    rows = those[:, None]
    return Motion(
        np.where(rows[:, None], other.T, motions.T),
        np.where(rows, other.linear, motions.linear),
        np.where(rows, other.angular, motions.angular),
    )


def _off_centre(view: Motion, gazing: Motion) -> Motion:
    """Return how views are turned from those that look at the centre, in the axes of these."""
    back = np.swapaxes(gazing.T[:, :3, :3], 1, 2)
    T = np.zeros_like(view.T)
    T[:, :3, :3] = back @ view.T[:, :3, :3]
    spin = _times(back, view.angular - gazing.angular)
    return Motion(T, np.zeros_like(spin), spin)


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    products: FloatArray = np.einsum("nij,nj->ni", matrices, vectors)
    return products


def _array(course: Course) -> FloatArray:
    return np.stack([course.range_m, course.theta_rad, course.climb_m])
