"""Where a target is and how it moves, from measurements that are noisy, late, wrong or missing."""

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray, planar
from services.planner.motion import Motion
from services.planner.turn_model import (
    OMEGA,
    PHI,
    Agility,
    Belief,
    V,
    X,
    Y,
    correct,
    predict,
    wrap,
)

_KEPT = 32
"""Measurements that are remembered, so that one from between them can still be taken in."""
_GATES = {2: 18.42, 3: 21.11}
"""Squared Mahalanobis distances that one in 10,000 honest measurements exceeds: the quantiles of
chi-square with 2 and 3 degrees of freedom."""
_MOST_REFUSED = 5
"""After so many refusals in a row the filter is wrong, not the measurements: it starts anew."""
_LEAST_SIGMA_M, _LEAST_SIGMA_RAD = 1e-3, 1e-3
"""No tracker is better, whatever it says; it keeps the covariance away from zero."""
_START_SIGMA_M_S, _START_SIGMA_RAD_S = 1.0, 1.0
"""Of a target that nothing is known of."""
_UNKNOWN_HEADING_RAD = np.pi


@dataclass(frozen=True)
class Fix:
    """One measurement."""

    t_ns: int
    """When it was measured."""
    x_m: float
    y_m: float
    sigma_m: float
    phi_rad: float | None = None
    """Heading; None if only the place was measured."""
    sigma_rad: float = 0.0

    @property
    def values(self) -> FloatArray:
        """(2,) or (3,) what was measured."""
        return np.array([self.x_m, self.y_m] + ([] if self.phi_rad is None else [self.phi_rad]))

    @property
    def variances(self) -> FloatArray:
        """(2,) or (3,) of its errors."""
        place = max(self.sigma_m, _LEAST_SIGMA_M)
        heading = max(self.sigma_rad, _LEAST_SIGMA_RAD)
        return np.array([place, place] + ([] if self.phi_rad is None else [heading])) ** 2


@dataclass(frozen=True)
class _Entry:
    """A measurement and what is believed since."""

    fix: Fix
    belief: Belief
    refused_in_a_row: int
    num_refused: int
    is_first: bool = False
    """Whether speed and turn rate are nothing but the prior's."""


class TargetFilter:
    """An extended Kalman filter of the constant turn rate and velocity model.

    Measurements may come in any order: one from between the last 32 is put where it belongs, and
    all later ones are taken in again. One that is much too far from what is believed is refused.
    """

    def __init__(self, agility: Agility, bridge_s: float) -> None:
        """Know nothing yet.

        Args:
            agility: of the target.
            bridge_s: for how long without measurements it is believed to go on as it did.
        """
        self._agility, self._bridge_s = agility, bridge_s
        self._log: list[_Entry] = []
        self.num_used = 0
        """Measurements taken in; refused ones are among them."""
        self.num_repeated = 0
        """Of an instant that had been measured before; ignored."""
        self.num_late = 0
        """Older than all that is remembered; ignored."""

    @property
    def num_refused(self) -> int:
        """Outliers."""
        return self._log[-1].num_refused if self._log else 0

    @property
    def refused_in_a_row(self) -> int:
        """Outliers since the last that was none."""
        return self._log[-1].refused_in_a_row if self._log else 0

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest measurement; None before the first."""
        return self._log[-1].fix.t_ns if self._log else None

    def start(self, fix: Fix, belief: Belief) -> None:
        """Forget everything but `belief`, which holds at the time of `fix`."""
        self._log = [_Entry(fix, belief, 0, self.num_refused)]
        self.num_used += 1

    def add(self, fix: Fix) -> None:
        """Take a measurement in, in its place among the others."""
        at = bisect_left(self._log, fix.t_ns, key=lambda entry: entry.fix.t_ns)
        if at < len(self._log) and self._log[at].fix.t_ns == fix.t_ns:
            self.num_repeated += 1
            return
        if at == 0 and self._log:
            self.num_late += 1
            return
        later = [entry.fix for entry in self._log[at:]]
        del self._log[at:]
        for each in (fix, *later):
            self._log.append(self._after(self._log[-1], each) if self._log else _first(each, 0))
        del self._log[:-_KEPT]
        self.num_used += 1

    def at(self, t_ns: int) -> Belief | None:
        """Return what is believed of `t_ns`, not earlier than the newest measurement.

        When that is farther off than `bridge_s`, the target is believed to stand where it was by
        then. None before the first measurement.
        """
        if not self._log:
            return None
        newest = self._log[-1]
        dt_s = max(t_ns - newest.fix.t_ns, 0) * 1e-9
        belief = predict(newest.belief, min(dt_s, self._bridge_s), self._agility)
        if dt_s > self._bridge_s:
            mean = belief.mean.copy()
            mean[[V, OMEGA]] = 0.0
            belief = Belief(mean, belief.cov)
        return belief

    def _after(self, before: _Entry, fix: Fix) -> _Entry:
        dt_s = (fix.t_ns - before.fix.t_ns) * 1e-9
        if dt_s > self._bridge_s:  # It may have done anything since.
            return _first(fix, before.num_refused, float(before.belief.mean[PHI]))
        known = _guessed(before, fix, dt_s) if before.is_first else before.belief
        expected = predict(known, dt_s, self._agility)
        belief, distance = correct(expected, fix.values, fix.variances)
        if distance <= _GATES[len(fix.values)]:
            return _Entry(fix, belief, 0, before.num_refused)
        refused = before.num_refused + 1
        if before.refused_in_a_row + 1 >= _MOST_REFUSED:
            return _first(fix, refused, float(expected.mean[PHI]))
        return _Entry(fix, expected, before.refused_in_a_row + 1, refused)


def motion_of(belief: Belief) -> Motion:
    """Return the mean as a frame on the ground that moves."""
    mean = belief.mean
    ahead = np.array([np.cos(mean[PHI]), np.sin(mean[PHI]), 0.0])
    return Motion(
        T=planar(float(mean[X]), float(mean[Y]), float(mean[PHI])),
        linear=mean[V] * ahead,
        angular=np.array([0.0, 0.0, mean[OMEGA]]),
    )


def _first(fix: Fix, num_refused: int, phi_rad: float = 0.0) -> _Entry:
    """Begin at a measurement; `phi_rad` is the heading if it was not measured."""
    known = fix.phi_rad is not None
    mean = np.array([fix.x_m, fix.y_m, fix.phi_rad if known else phi_rad, 0.0, 0.0])
    heading = fix.variances[2] if known else _UNKNOWN_HEADING_RAD**2
    place = fix.variances[0]
    variances = [place, place, heading, _START_SIGMA_M_S**2, _START_SIGMA_RAD_S**2]
    return _Entry(fix, Belief(mean, np.diag(variances)), 0, num_refused, is_first=True)


def _guessed(first: _Entry, second: Fix, dt_s: float) -> Belief:
    """Linearise about the motion between the first two measurements, not about standing.

    A fast target's heading changes too much for that. Measurements so close in time that they say
    nothing of it, or that no target of the prior could have made, leave the belief as it is.
    """
    phi, other = first.fix.phi_rad, second.phi_rad
    if phi is None or other is None:
        return first.belief
    noise = np.sqrt(first.fix.variances + second.variances)
    turn = wrap(other - phi)
    ahead = np.array([np.cos(phi + turn / 2), np.sin(phi + turn / 2)])
    way = float(ahead @ (second.values[:2] - first.fix.values[:2]))
    v, omega = way / dt_s / np.sinc(turn / (2 * np.pi)), turn / dt_s
    prior = np.array([_START_SIGMA_M_S, _START_SIGMA_RAD_S])
    if (noise[[X, PHI]] > dt_s * prior).any() or (np.abs([v, omega]) > 4 * prior).any():
        return first.belief
    return Belief(np.array([*first.belief.mean[:V], v, omega]), first.belief.cov)
