"""Strategy B: the formation opens where the path is straight and closes where it bends.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, case 1. It needs the whole motion
in advance.
"""

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.bumps import bump_centres, bump_sum
from services.planner.feasibility import check
from services.planner.known_motion import KnownMotion, curvature, greatest_curvature
from services.planner.planar import Slots
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.scale_bounds import scale_range

NUM_BUMPS = 200  # N_delta, the article's number.
_WIDTHS = np.geomspace(1.0, 24.0, 24)
"""Widths c that are tried, in steps between bumps."""
_HALVINGS = 16
"""The height a is found to 1e-5 of what would open the formation without end."""


def adaptive_scale(motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits) -> Slots:
    """Open the formation as far as bumps of one height and width allow.

    The height a and the width c make the integral of kappa_L - kappa_r greatest as long as every
    rule holds; if not even the unopened formation obeys them, it is what is returned.

    Args:
        motion: of the target.
        num_cameras: N.
        d_m: scale in the sharpest turn.
        limits: to be kept.
    """
    theta = ring_angles(num_cameras)
    best, gain = Slots(d_m, theta), 0.0
    if limits.drive == "flying" or greatest_curvature(motion.target) == 0:
        return best  # Nothing closes it, so nothing opens it.
    if not check(motion.target, best, limits).feasible:
        return best
    for width_s in _WIDTHS * (motion.t_s[-1] - motion.t_s[0]) / NUM_BUMPS:
        waves = bump_waves(motion, d_m, limits, float(width_s))
        a = _greatest_height(motion, theta, d_m, waves, limits)
        if -a * waves[0].sum() > gain:
            best, gain = opened(d_m, a * waves, theta), float(-a * waves[0].sum())
    return best


def bump_waves(
    motion: KnownMotion, d_m: float, limits: Limits, width_s: float, *, wraps: bool = True
) -> FloatArray:
    """Return (3, T): sum over b of (kappa_wc(b) - kappa_L) exp(-(t - b)^2 / (2 c^2)), derivatives.

    kappa_L = 1 / d is what the sharpest turn asks for, kappa_wc(b) what the turn at b would.

    Args:
        motion: of the target.
        d_m: scale in the sharpest turn.
        limits: to be kept.
        width_s: c.
        wraps: on a closed lap the bumps go round with it. Without, the formation must close and
            open in haste at its ends, where half of the bumps are missing.
    """
    period_s = motion.period_s if wraps else None
    centres = bump_centres(motion.t_s, NUM_BUMPS, closed=period_s is not None)
    bends = np.interp(centres, motion.t_s, np.abs(curvature(motion.target)))
    heights = np.minimum([_tightness(float(bend), limits) - 1 / d_m for bend in bends], 0.0)
    return bump_sum(motion.t_s, centres, heights, width_s, period_s)


def opened(d_m: float, waves: FloatArray, theta_rad: FloatArray) -> Slots:
    """Turn waves (3, T) of 1 / d about its base into scales and their derivatives."""
    kappa, rate, push = 1 / d_m + waves[0], waves[1], waves[2]
    return Slots(
        d_m=1 / kappa,
        d_dot=-rate / kappa**2,
        d_ddot=2 * rate**2 / kappa**3 - push / kappa**2,
        theta_rad=theta_rad,
    )


def _tightness(kappa: float, limits: Limits) -> float:
    """Return 1 / d of the greatest scale that this curvature allows; infinite if it allows none."""
    allowed = scale_range(limits.beta_rad, kappa, limits.target_radius_m)
    return 1 / allowed[1] if allowed is not None and allowed[1] > 0 else np.inf


def _greatest_height(
    motion: KnownMotion, theta: FloatArray, d_m: float, waves: FloatArray, limits: Limits
) -> float:
    depth = float(-waves[0].min())
    low, high = 0.0, 1 / (d_m * depth) if depth > 0 else 0.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        report = check(motion.target, opened(d_m, middle * waves, theta), limits)
        low, high = (middle, high) if report.feasible else (low, middle)
    return low
