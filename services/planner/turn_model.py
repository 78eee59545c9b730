"""A target that keeps its speed and turn rate but for random changes: the filter's equations.

State: x, y (m, world), phi (heading, rad), v (m/s, along the heading, negative in reverse), omega
(rad/s). Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and
Navigation", 2001, sect. 11.7 (coordinated turn) and 5.4 (Joseph form); the arc is written as a
chord, so that nothing is divided by omega.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from services.kernels.rigid import FloatArray

X, Y, PHI, V, OMEGA = range(5)
_LONGEST_STEP_S = 0.1
"""The covariance is carried in steps of at most this: it is linear only over short times."""
_SMALL_RAD = 1e-3
"""Below it the series of sin(h)/h is exact to 1e-15."""


class Belief(NamedTuple):
    """A normal distribution of the state."""

    mean: FloatArray
    """(5,)"""
    cov: FloatArray
    """(5, 5) symmetric, positive definite."""


@dataclass(frozen=True)
class Agility:
    """How much speed and turn rate change by chance: densities of white accelerations."""

    linear: float
    """m/s^2 per sqrt(Hz)."""
    angular: float
    """rad/s^2 per sqrt(Hz)."""


def predict(belief: Belief, dt_s: float, agility: Agility) -> Belief:
    """Carry a belief `dt_s` >= 0 ahead."""
    steps = max(1, math.ceil(dt_s / _LONGEST_STEP_S))
    for _ in range(steps if dt_s > 0 else 0):
        mean, F = moved(belief.mean, dt_s / steps)
        grown = F @ belief.cov @ F.T + _process_noise(belief.mean, dt_s / steps, agility)
        belief = Belief(mean, (grown + grown.T) / 2)
    return belief


def moved(mean: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Drive an arc for `dt_s`.

    Returns:
        (5,) the state there, and its (5, 5) derivative by the state before.
    """
    x, y, phi, v, omega = (float(part) for part in mean)
    half = omega * dt_s / 2
    chord, slope = _sinc(half)
    c, s = math.cos(phi + half), math.sin(phi + half)
    way = v * dt_s * chord
    F = np.eye(5)
    F[X, PHI], F[Y, PHI] = -way * s, way * c
    F[X, V], F[Y, V] = dt_s * chord * c, dt_s * chord * s
    F[X, OMEGA] = v * dt_s**2 / 2 * (slope * c - chord * s)
    F[Y, OMEGA] = v * dt_s**2 / 2 * (slope * s + chord * c)
    F[PHI, OMEGA] = dt_s
    there = [x + way * c, y + way * s, wrap(phi + omega * dt_s), v, omega]
    return np.array(there), F


def correct(belief: Belief, measured: FloatArray, variances: FloatArray) -> tuple[Belief, float]:
    """Take in a measurement of the first M parts of the state.

    Args:
        belief: at the time of the measurement.
        measured: (M,), M is 2 (x, y) or 3 (x, y, phi).
        variances: (M,) of its independent errors, positive.

    Returns:
        The better belief, and the squared Mahalanobis distance of the measurement from the old.
    """
    n = len(measured)
    H, R = np.eye(5)[:n], np.diag(variances)
    innovation = measured - belief.mean[:n]
    if n > PHI:
        innovation[PHI] = wrap(innovation[PHI])
    S = belief.cov[:n, :n] + R
    K = np.linalg.solve(S, H @ belief.cov).T
    mean = belief.mean + K @ innovation
    mean[PHI] = wrap(mean[PHI])
    kept = np.eye(5) - K @ H
    cov = kept @ belief.cov @ kept.T + K @ R @ K.T
    distance = float(innovation @ np.linalg.solve(S, innovation))
    return Belief(mean, (cov + cov.T) / 2), distance


def wrap(angle_rad: float) -> float:
    """Return the same angle in [-pi, pi]."""
    return math.remainder(angle_rad, 2 * math.pi)


def _sinc(h: float) -> tuple[float, float]:
    """Return sin(h) / h and its derivative."""
    if abs(h) < _SMALL_RAD:
        return 1 - h * h / 6, -h / 3 + h**3 / 30
    return math.sin(h) / h, (math.cos(h) - math.sin(h) / h) / h


def _process_noise(mean: FloatArray, dt_s: float, agility: Agility) -> FloatArray:
    """Return the (5, 5) covariance that white accelerations add in a short time.

    Source: Bar-Shalom et al., eq. 6.2.2-12 (discretised continuous white noise acceleration).
    """
    a = mean[PHI] + mean[OMEGA] * dt_s / 2
    ahead = np.zeros(5)
    ahead[X], ahead[Y] = math.cos(a), math.sin(a)
    G = np.stack([ahead, np.eye(5)[V], np.eye(5)[PHI], np.eye(5)[OMEGA]], axis=1)
    block = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    Q = np.zeros((4, 4))
    Q[:2, :2], Q[2:, 2:] = agility.linear**2 * block, agility.angular**2 * block
    noise: FloatArray = G @ Q @ G.T
    return noise
