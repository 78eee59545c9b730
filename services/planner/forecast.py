"""How the target will move: as it does now, or along a path that is known."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.known_motion import KnownMotion, curvature
from services.planner.planar import PlanarMotion

SLOWEST_MPS = 0.05
"""Of a target that is slower, the curvature of its path is noise."""
UNFORESEEN_RAD = float(np.radians(4.0))
"""Kept free of the field of view for what a constant twist does not tell: the turn that begins.
The article's 3 to 4 degrees for what is not known of the target's velocity."""
_OFF_M = 0.05
_OFF_RAD = 0.1
"""A target farther off its path, or heading elsewhere, is not on it."""
_FINE = 4096
"""Places on the path between which is interpolated: rates to 1e-6 of the greatest."""


class Bends(NamedTuple):
    """Signed curvatures between which all known turns are, 1/m; left turns are positive."""

    least: float
    greatest: float

    @property
    def sharpest(self) -> float:
        """The greatest to either side."""
        return max(-self.least, self.greatest)


@dataclass(frozen=True)
class Ahead:
    """What the target will do."""

    target: PlanarMotion
    """At K instants; velocities alone count, places are not told."""
    bends: Bends
    """Of what has been, what is ahead, and what is known besides."""
    reserve_rad: float
    """To be kept free of the field of view, for what may come otherwise."""


class Forecast(Protocol):
    """What lets the motion of the target be told in advance."""

    def ahead(self, target: PlanarMotion, after_s: FloatArray) -> Ahead:
        """Return how the target will move (K,) instants after it moved so; does not remember."""
        ...

    def saw(self, target: PlanarMotion) -> None:
        """Remember how the target moved."""
        ...

    def forget(self) -> None:
        """Forget how the target moved: the world was reset."""
        ...


class TwistForecast:
    """The target goes on as it does: v and omega are constant. Turns are known once seen."""

    def __init__(self) -> None:
        self._seen = Bends(0.0, 0.0)

    def ahead(self, target: PlanarMotion, after_s: FloatArray) -> Ahead:
        """Return the same velocities at all instants; see `Forecast`."""
        v, omega = float(target.v_mps), float(target.omega_rps)
        bend = _bend(v, omega)
        if abs(v) < SLOWEST_MPS:
            omega = 0.0
        zero = np.zeros_like(after_s)
        bends = Bends(min(self._seen.least, bend), max(self._seen.greatest, bend))
        motion = PlanarMotion(zero, zero, zero, v + zero, omega + zero, zero, zero)
        return Ahead(motion, bends, UNFORESEEN_RAD)

    def saw(self, target: PlanarMotion) -> None:
        """Remember how sharply it turned."""
        bend = _bend(float(target.v_mps), float(target.omega_rps))
        self._seen = Bends(min(self._seen.least, bend), max(self._seen.greatest, bend))

    def forget(self) -> None:
        """Forget the turns."""
        self._seen = Bends(0.0, 0.0)


class PathForecast:
    """The target drives along a known path, as fast as it does now in proportion to the plan.

    Where it is on the path, its place and heading tell: a target that started late, or drives
    slower than planned, is found where it is. One that is off the path goes on as it does.
    """

    def __init__(self, lap: KnownMotion) -> None:
        """Take the path.

        Args:
            lap: of it; what comes after its end is the lap again if it is closed, and as the end
                if it is not.
        """
        self._otherwise = TwistForecast()
        self._t_s = lap.t_s
        self._lap = lap.target
        self._period_s = lap.period_s
        path = lap.target
        self._places = np.stack([path.x_m, path.y_m], axis=1)
        self._ways = np.stack([np.cos(path.phi_rad), np.sin(path.phi_rad)], axis=1)
        bends = curvature(path)
        self._bends = Bends(min(0.0, float(bends.min())), max(0.0, float(bends.max())))
        self._reach_m = max(_OFF_M, _OFF_M * float(np.ptp(self._places, axis=0).max()))

    def ahead(self, target: PlanarMotion, after_s: FloatArray) -> Ahead:
        """Return velocities along the path; see `Forecast`."""
        at_s = self.locate(target)
        if at_s is None:
            return self._otherwise.ahead(target, after_s)
        planned = float(self._rate(np.array([at_s]), self._lap.v_mps)[0])
        share = float(target.v_mps) / planned if planned > 0 else 1.0
        t_s = at_s + share * after_s
        v, omega, v_dot, omega_dot = (
            self._rate(t_s, series)
            for series in (
                self._lap.v_mps,
                self._lap.omega_rps,
                self._lap.v_dot,
                self._lap.omega_dot,
            )
        )
        zero = np.zeros_like(after_s)
        motion = PlanarMotion(
            zero, zero, zero, share * v, share * omega, share**2 * v_dot, share**2 * omega_dot
        )
        return Ahead(motion, self._bends, reserve_rad=0.0)

    def saw(self, target: PlanarMotion) -> None:
        """Remember turns that the path does not have."""
        if self.locate(target) is None:
            self._otherwise.saw(target)

    def forget(self) -> None:
        """Forget turns that the path does not have."""
        self._otherwise.forget()

    def locate(self, target: PlanarMotion) -> float | None:
        """Return when, in the planned lap, the target would be where it is; None: off the path.

        The nearest place counts whose heading agrees, as a path may cross itself.
        """
        place = np.array([float(target.x_m), float(target.y_m)])
        way = np.array([np.cos(target.phi_rad), np.sin(target.phi_rad)]).reshape(2)
        away_m = np.hypot(*(self._places - place).T)
        turned = self._ways @ way
        away_m[turned < np.cos(_OFF_RAD)] = np.inf
        nearest = int(np.argmin(away_m))
        if away_m[nearest] > self._reach_m:
            return None
        v = float(np.asarray(self._lap.v_mps)[nearest])
        if v <= 0:
            return float(self._t_s[nearest])
        along_m = float((place - self._places[nearest]) @ self._ways[nearest])
        return float(self._t_s[nearest]) + along_m / v

    def _rate(self, t_s: FloatArray, series: object) -> FloatArray:
        values = np.asarray(series, np.float64)
        if self._period_s is not None:
            t_s = np.mod(t_s - self._t_s[0], self._period_s) + self._t_s[0]
        return np.interp(t_s, self._t_s, values)


def _bend(v_mps: float, omega_rps: float) -> float:
    return omega_rps / v_mps if abs(v_mps) >= SLOWEST_MPS else 0.0
