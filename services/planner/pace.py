"""How long a change must take so that no camera flies or turns faster than it may."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.planner.course import Course
from services.planner.detours import bump
from services.planner.ease import ease
from services.planner.overhead import directions_of, tilts_of
from services.planner.planar import wrapped

INSTANTS = np.linspace(0, 1, 49)
"""At which ways are looked at, of the time that a change takes."""
SHARES, _RATES = ease(INSTANTS)
_RATE_DOTS = 60 * INSTANTS * (1 - INSTANTS) * (1 - 2 * INSTANTS)
_STILL_M = 1e-9
_LEAST_LEFT = 0.2
"""Of a limit that ends which move use up by themselves, so much is for the change all the same."""
_SHARE_STEP = 1e-3
"""For differences: the error is of its square."""


class Pace(NamedTuple):
    """What a change may do at most."""

    speed_mps: float
    acceleration_mps2: float = 4.8
    """Of the drive's 5; the rest is for the target's own."""
    turn_rps: float = 1.8
    """Likewise of the drive's 2.5."""


class Ways(NamedTuple):
    """Where cameras come from and where they go, at each of `INSTANTS`."""

    before: Course
    """(S, N)"""
    after: Course
    """(S, N)"""
    turn_rad: FloatArray
    """(S, N) from one to the other around the target; S may be 1: the ends are at rest."""
    over: NDArray[np.bool_]
    """(N,) which lead over the target instead, straight in tilts: see `Overhead`."""
    spin_rps: float = 0.0
    """How fast the target turns: it swings cameras on detours along."""

    @property
    def at_rest(self) -> bool:
        """Whether no end moves."""
        ends = np.stack([self.before.arms_m(), self.after.arms_m()])
        return bool(np.ptp(ends, axis=1).max() < _STILL_M)

    @classmethod
    def straight(cls, before: Course, after: Course) -> "Ways":
        """Return the ways of (N,) cameras between ends at rest, by the shorter side."""
        start, end = (
            Course(each.range_m[None], each.theta_rad[None], each.climb_m[None])
            for each in (before, after)
        )
        level = np.zeros_like(before.range_m, np.bool_)
        return cls(start, end, wrapped(end.theta_rad - start.theta_rad), level)

    def own_speeds(self, lasting_s: float) -> FloatArray:
        """Return (S, N) bounds on what cameras would do between ends that do not change, m/s."""
        if len(self.turn_rad) == 1:
            return np.zeros_like(self.turn_rad)
        step_s = lasting_s / (len(self.turn_rad) - 1)
        speeds = [
            np.linalg.norm(np.gradient(end.arms_m(), step_s, axis=0), axis=-1)
            for end in (self.before, self.after)
        ]
        share = SHARES[:, None]
        own: FloatArray = (1 - share) * speeds[0] + share * speeds[1]
        return own

    def at(self, share: FloatArray, out_m: FloatArray) -> Course:
        """Return (S, N) where cameras are, at the instants' shares of the ways, with detours."""
        column = share[:, None]
        way = self.before.towards(self.after, self.turn_rad, column)
        if np.any(self.over):
            start, end = tilts_of(self.before.arms_m()), tilts_of(self.after.arms_m())
            directions = directions_of(start + column[..., None] * (end - start))
            above = Course.to(way.range_m[..., None] * directions)
            way = way.except_where(self.over, above)
        return way.farther(bump(column) * out_m, self.over)

    def turns_rad(self, nod_rad: FloatArray) -> FloatArray:
        """Return (S, N) how far cameras turn that look at the centre, per share of their ways.

        Args:
            nod_rad: (S, N) how far up.
        """
        around: FloatArray = np.hypot(self.turn_rad, nod_rad)
        if not np.any(self.over):
            return around
        tilts = tilts_of(self.after.arms_m()) - tilts_of(self.before.arms_m())
        turns: FloatArray = np.where(self.over, np.linalg.norm(tilts, axis=-1), around)
        return turns


def time_needed(
    ways: Ways, lasting_s: float, out_m: FloatArray, roll_rad: FloatArray, pace: Pace
) -> float:
    """Return how long a change takes at that pace, s.

    Ends that move leave less of the speed to the change, but a share of it always.

    Args:
        ways: of N cameras.
        lasting_s: what the change was taken to last when these were looked at.
        out_m: (N,) detours.
        roll_rad: (N,) how far views turn against those that look at the centre.
        pace: of the change.
    """
    back, here, ahead = (ways.at(SHARES + step, out_m) for step in (-_SHARE_STEP, 0.0, _SHARE_STEP))
    arms = [each.arms_m() for each in (back, here, ahead)]
    slope = (arms[2] - arms[0]) / (2 * _SHARE_STEP)
    bend = (arms[2] - 2 * arms[1] + arms[0]) / _SHARE_STEP**2
    rate, rate_dot = _RATES[:, None], _RATE_DOTS[:, None]
    speed = rate * np.linalg.norm(slope, axis=-1)
    strain = rate[..., None] ** 2 * bend + rate_dot[..., None] * slope
    own = ways.own_speeds(lasting_s) + ways.spin_rps * bump(SHARES)[:, None] * out_m
    own_turning = own / np.maximum(here.range_m, _STILL_M)
    nod = (ahead.elevation_rad - back.elevation_rad) / (2 * _SHARE_STEP)
    turning = rate * (ways.turns_rad(nod) + roll_rad)
    needed_s = (
        np.max(speed / _left(pace.speed_mps, own)),
        np.max(np.linalg.norm(strain, axis=-1) / pace.acceleration_mps2) ** 0.5,
        np.max(turning / _left(pace.turn_rps, own_turning)),
    )
    return float(max(needed_s))


def _left(limit: float, own: FloatArray) -> FloatArray:
    """Return what is left of a limit."""
    left: FloatArray = np.maximum(limit - own, _LEAST_LEFT * limit)
    return left
