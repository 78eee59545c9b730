"""Target motions that are known in advance: what a plan is made and checked on.

The paths are those a target is usually told to drive; nothing is taken from a simulator.
"""

from dataclasses import dataclass, fields
from typing import Literal, assert_never

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.errors import PlannerError
from services.planner.planar import PlanarMotion

PathName = Literal["ellipse", "circle", "line", "eight", "static"]
_TURNING_RPS = 1e-12
"""Slower than this a target does not turn on the spot, it stands."""
_CLOSING = 1e-9
"""A lap is closed whose ends differ by so little of what is greatest on it."""


@dataclass(frozen=True)
class KnownMotion:
    """The target at T instants, evenly spaced."""

    t_s: FloatArray
    """(T,) from the first instant on."""
    target: PlanarMotion
    """Of each instant: arrays (T,)."""

    @property
    def period_s(self) -> float | None:
        """After so long the target is where it was and drives as it did; None: it is not."""
        target = self.target
        turn = np.exp(1j * np.asarray(target.phi_rad))
        states = np.stack(
            [target.x_m, target.y_m, turn.real, turn.imag, target.v_mps, target.omega_rps]
        )
        size = np.abs(states).max(axis=1)
        closed = (np.abs(states[:, -1] - states[:, 0]) <= _CLOSING * size).all()
        return float(self.t_s[-1] - self.t_s[0]) if closed else None

    def every(self, step: int) -> "KnownMotion":
        """Return every so many-th instant of it."""
        rows = {f.name: getattr(self.target, f.name)[::step] for f in fields(self.target)}
        return KnownMotion(self.t_s[::step], PlanarMotion(**rows))


def known_path(
    kind: PathName, semi_axes_m: tuple[float, float], lap_s: float, num_instants: int = 721
) -> KnownMotion:
    """Return one lap of a path in closed form, from the origin, both ends included.

    The ellipse is that of the article, x = a sin(tau), y = b (1 - cos(tau)), tau = 2 pi t / lap;
    a circle has radius a, a line is 2 a long, an eight is Gerono's.

    Args:
        kind: of the path.
        semi_axes_m: half lengths a and b along x and y.
        lap_s: duration of the lap.
        num_instants: T.

    Raises:
        PlannerError: If a measure is not positive or there are less than two instants.
    """
    a, b = semi_axes_m
    if not (np.isfinite([a, b, lap_s]).all() and min(a, b, lap_s) > 0 and num_instants >= 2):
        raise PlannerError(
            f"semi-axes {a:g} x {b:g} m, lap {lap_s:g} s, {num_instants} instants: the measures "
            "must be positive and finite, the instants two or more"
        )
    t_s = np.linspace(0.0, lap_s, num_instants)
    n = 2 * np.pi / lap_s
    match kind:
        case "ellipse":
            target = _on_curve(_wave(a, n, t_s), _bow(b, n, t_s))
        case "circle":
            target = _on_curve(_wave(a, n, t_s), _bow(a, n, t_s))
        case "eight":
            target = _on_curve(_wave(a, n, t_s), _wave(b, 2 * n, t_s))
        case "line":
            v, zero = np.full_like(t_s, 2 * a / lap_s), np.zeros_like(t_s)
            target = PlanarMotion(v * t_s, zero, zero, v, zero, zero, zero)
        case "static":
            target = PlanarMotion(*np.zeros((7, num_instants)))
        case _:
            assert_never(kind)
    return KnownMotion(t_s, target)


def curvature(target: PlanarMotion) -> FloatArray:
    """Return kappa_s = omega / v, 1/m, signed; 0 where the target stands, infinite on the spot."""
    v, omega = np.broadcast_arrays(
        np.atleast_1d(np.asarray(target.v_mps, np.float64)), target.omega_rps
    )
    stands = v == 0.0
    spins = np.where(np.abs(omega) > _TURNING_RPS, np.copysign(np.inf, omega), 0.0)
    bend: FloatArray = np.where(stands, spins, omega / np.where(stands, 1.0, v))
    return bend


def greatest_curvature(target: PlanarMotion) -> float:
    """Return kappa_max, 1/m."""
    return float(np.abs(curvature(target)).max())


def _wave(size: float, rate: float, t_s: FloatArray) -> FloatArray:
    """Return (4, T): size sin(rate t) and its three derivatives."""
    s, c = np.sin(rate * t_s), np.cos(rate * t_s)
    return size * np.stack([s, rate * c, -(rate**2) * s, -(rate**3) * c])


def _bow(size: float, rate: float, t_s: FloatArray) -> FloatArray:
    """Return (4, T): size (1 - cos(rate t)) and its three derivatives."""
    s, c = np.sin(rate * t_s), np.cos(rate * t_s)
    return size * np.stack([1 - c, rate * s, rate**2 * c, -(rate**3) * s])


def _on_curve(x: FloatArray, y: FloatArray) -> PlanarMotion:
    """Turn coordinates (4, T) with three derivatives into a unicycle's motion."""
    v = np.hypot(x[1], y[1])
    v_dot = (x[1] * x[2] + y[1] * y[2]) / v
    omega = (x[1] * y[2] - y[1] * x[2]) / v**2
    omega_dot = (x[1] * y[3] - y[1] * x[3]) / v**2 - 2 * omega * v_dot / v
    return PlanarMotion(x[0], y[0], np.arctan2(y[1], x[1]), v, omega, v_dot, omega_dot)
