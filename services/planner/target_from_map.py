"""Where the target is, from the map alone: the middle of what is occupied above the ground.

The paper asks for this when no tracker exists. Its limits: the target stands alone within reach;
its place is the middle of the surface that is seen, which is a few centimetres off for a body that
is not symmetric or not seen all round; a heading is only known from the motion. Of the two ways in
which a unicycle can move along a line, forwards and in reverse, the nearer to the heading before
is believed; the very first motion is taken to be forwards.
"""

import math
from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.target_filter import Fix, TargetFilter
from services.planner.turn_model import OMEGA, PHI, Agility, Belief, V, wrap

_FEWEST_VOXELS = 10
"""Fewer are noise."""
_TRAIL_NS = 1_000_000_000
"""Over this time it is judged whether the target moves."""
_FEWEST_FIXES = 4
_CERTAIN = 4.0
"""It moves when its speed is so many standard deviations from 0, and stands again below one."""
_MOST_REFUSED = 3
_TURN_SIGMA_RAD_S = 1.0
"""Of the turn rate as it begins to move."""


@dataclass(frozen=True)
class Sight:
    """How a map is looked at."""

    ground_m: float
    reach_m: float
    sigma_m: float


def middle(points_m: FloatArray, sight: Sight, near_m: FloatArray | None) -> FloatArray | None:
    """Return the (2,) centroid of what is above the ground.

    Args:
        points_m: (N, 3) centres of the occupied voxels, world.
        sight: what counts.
        near_m: (2,) only what is within reach of it counts; None: all.

    Returns:
        None if it is too little.
    """
    above = points_m[points_m[:, 2] > sight.ground_m, :2]
    if near_m is not None:
        above = above[np.hypot(*(above - near_m).T) <= sight.reach_m]
    if len(above) < _FEWEST_VOXELS:
        return None
    centroid: FloatArray = above.mean(axis=0)
    return centroid


class TargetFromMap:
    """Stands until it has surely moved; then the filter follows it, its places measured alone."""

    def __init__(self, agility: Agility, bridge_s: float, sight: Sight, heading_rad: float) -> None:
        self._filter = TargetFilter(agility, bridge_s)
        self._bridge_ns, self._sight = round(bridge_s * 1e9), sight
        self._heading_rad = heading_rad
        self._has_moved = self._moves = False
        self._trail: list[tuple[int, FloatArray]] = []
        """Times and places since it stands, of the last second."""
        self.num_used = self.num_missed = 0
        """Instants at which it was seen, and not."""

    @property
    def num_refused(self) -> int:
        """Places at which it cannot have been."""
        return self._filter.num_refused

    def see(self, t_ns: int, points_m: FloatArray) -> None:
        """Look for the target among the (N, 3) occupied voxels' centres of an instant, world."""
        seen_ns = self._newest_ns
        is_lost = seen_ns is None or t_ns - seen_ns > self._bridge_ns
        expected = self.at(t_ns)
        near = None if is_lost or expected is None else expected.mean[:2]
        place = middle(points_m, self._sight, near)
        if place is None:
            self.num_missed += 1
            return
        self.num_used += 1
        if self._moves and not is_lost:
            self._filter.add(Fix(t_ns, float(place[0]), float(place[1]), self._sight.sigma_m))
            if self._has_stopped():
                self._stand(t_ns, place)
        else:
            if is_lost:
                self._stand(t_ns, place)
            else:
                self._trail.append((t_ns, place))
            self._trail = [each for each in self._trail if t_ns - each[0] <= _TRAIL_NS]
            self._set_off()

    def at(self, t_ns: int) -> Belief | None:
        """Return what is believed of `t_ns`, not before the last look; None: never seen."""
        if self._moves:
            return self._filter.at(t_ns)
        if not self._trail:
            return None
        place = np.mean([place for _, place in self._trail], axis=0)
        mean = np.array([*place, self._heading_rad, 0.0, 0.0])
        sigma = self._sight.sigma_m
        return Belief(mean, np.diag(np.array([sigma, sigma, math.pi, sigma, sigma]) ** 2))

    @property
    def _newest_ns(self) -> int | None:
        if self._moves:
            return self._filter.newest_ns
        return self._trail[-1][0] if self._trail else None

    def _has_stopped(self) -> bool:
        newest = self._filter.newest_ns
        belief = None if newest is None else self._filter.at(newest)
        assert belief is not None
        slow = abs(belief.mean[V]) < math.sqrt(belief.cov[V, V])
        return slow or self._filter.refused_in_a_row >= _MOST_REFUSED

    def _stand(self, t_ns: int, place: FloatArray) -> None:
        belief = self._filter.at(t_ns) if self._moves else None
        if belief is not None:
            self._heading_rad = float(belief.mean[PHI])
        self._moves, self._trail = False, [(t_ns, place)]

    def _set_off(self) -> None:
        """Hand over to the filter if a straight line through the trail is surely no standing."""
        line = _line(self._trail, self._sight.sigma_m)
        if line is None or line.certainty < _CERTAIN:
            return
        t_ns, belief = self._trail[-1][0], line.belief(self._heading_rad, self._has_moved)
        x, y = belief.mean[:2]
        self._filter.start(Fix(t_ns, float(x), float(y), self._sight.sigma_m), belief)
        self._has_moved = self._moves = True


@dataclass(frozen=True)
class _Line:
    """Places on a straight line, at constant velocity."""

    place_m: FloatArray
    """(2,) at the last of them."""
    velocity: FloatArray
    """(2,) m/s."""
    cov: FloatArray
    """(2, 2) of place and velocity along one axis; both axes are alike."""

    @property
    def certainty(self) -> float:
        """How many standard deviations the speed is from 0."""
        return float(np.hypot(*self.velocity)) / math.sqrt(self.cov[1, 1])

    def belief(self, heading_rad: float, may_reverse: bool) -> Belief:
        """Return the state of a unicycle that moves so.

        Args:
            heading_rad: it had before. may_reverse: whether it keeps that if it moves backwards.
        """
        speed = float(np.hypot(*self.velocity))
        heading = math.atan2(self.velocity[1], self.velocity[0])
        if may_reverse and abs(wrap(heading - heading_rad)) > math.pi / 2:
            heading, speed = wrap(heading + math.pi), -speed
        c, s = math.cos(heading), math.sin(heading)
        J = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -s / speed, c / speed], [0, 0, c, s]])
        cov = np.zeros((5, 5))
        cov[:OMEGA, :OMEGA] = J @ np.kron(self.cov, np.eye(2)) @ J.T
        cov[OMEGA, OMEGA] = _TURN_SIGMA_RAD_S**2
        return Belief(np.array([*self.place_m, heading, speed, 0.0]), (cov + cov.T) / 2)


def _line(trail: list[tuple[int, FloatArray]], sigma_m: float) -> _Line | None:
    """Fit by least squares; None if there is not enough to fit to."""
    since = np.array([t_ns - trail[0][0] for t_ns, _ in trail]) * 1e-9
    since -= since.mean()
    places, last, spread = np.array([place for _, place in trail]), since[-1], since @ since
    if len(trail) < _FEWEST_FIXES or spread == 0.0:
        return None
    velocity = since @ places / spread
    cov = np.array(
        [[1 / len(trail) + last**2 / spread, last / spread], [last / spread, 1 / spread]]
    )
    return _Line(places.mean(axis=0) + last * velocity, velocity, sigma_m**2 * cov)
