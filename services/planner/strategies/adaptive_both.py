"""Strategies B and D together: the formation opens where the path is straight, and its robots move
along the circle where it bends.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, sect. V, the mixed objective of
cases 1 and 3. It needs the whole motion in advance.
"""

from collections.abc import Iterator

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.errors import InfeasibleError
from services.planner.feasibility import check
from services.planner.known_motion import KnownMotion
from services.planner.planar import Slots
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.strategies.adaptive_angles import GAINS, NUM_BUMPS, WIDTHS, moved
from services.planner.strategies.adaptive_scale import bump_waves, opened

_WIDTHS = np.geomspace(1.0, 24.0, 8)
"""Widths c of the scale's bumps that are tried, in steps between bumps."""
_SHARES = np.linspace(0.1, 0.8, 8)
"""Heights a that are tried, of what would open the formation without end."""
_ANGLE_WIDTHS = np.geomspace(2.0, 50.0, 6)
_ANGLE_GAINS = np.linspace(0.9, 4.0, 24)
_COARSELY = 121
"""So many instants, about, are enough to choose; what is chosen is planned on all of them."""


def adaptive_both(
    motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits, alpha: float
) -> Slots:
    """Open the formation for what it is worth, and move its robots as far as that asks for.

    Of the scales kappa_r(t) = kappa_L + a sum over b of (kappa_wc(b) - kappa_L) bump_b(t), a >= 0,
    and the least moves theta_i(t) with which each keeps every rule, the one is taken whose integral
    of alpha (kappa_L - kappa_r) - (1 - alpha) mean over i of |theta_0i - theta_i| is the greatest:
    the article's objective, with signs by which both of its parts are gains.

    Args:
        motion: of the target.
        num_cameras: N.
        d_m: scale in the sharpest turn; with moving angles it may be beyond d_c.
        limits: to be kept.
        alpha: 0: even angles matter alone; 1: the scale alone.

    Raises:
        InfeasibleError: If not even the unopened formation has such moves.
    """
    even = Slots(d_m, ring_angles(num_cameras))
    if limits.drive == "flying":
        return even  # Nothing closes it, so nothing opens it.
    best = moved(motion, even, limits)
    coarse = motion.every(max(1, (len(motion.t_s) - 1) // (_COARSELY - 1)))
    tried = []
    for bumps in _candidates(coarse, d_m, limits):
        found = _planned(coarse, even, limits, bumps, _ANGLE_WIDTHS, _ANGLE_GAINS)
        if found is not None:
            tried.append((_worth(found, d_m, alpha), bumps))
    for _, bumps in sorted(tried, reverse=True):
        found = _planned(motion, even, limits, bumps, WIDTHS, GAINS)
        if found is not None:
            return max((found, best), key=lambda slots: _worth(slots, d_m, alpha))
    return best


def _candidates(motion: KnownMotion, d_m: float, limits: Limits) -> Iterator[tuple[float, float]]:
    """Yield the widths, s, and heights of the scale's bumps that are tried."""
    step_s = float(motion.t_s[-1] - motion.t_s[0]) / NUM_BUMPS
    for width_s in (_WIDTHS * step_s).tolist():
        depth = float(-bump_waves(motion, d_m, limits, width_s)[0].min())
        if depth > 0:
            yield from ((width_s, share / (d_m * depth)) for share in _SHARES.tolist())


def _planned(
    motion: KnownMotion,
    even: Slots,
    limits: Limits,
    bumps: tuple[float, float],
    widths: FloatArray,
    gains: FloatArray,
) -> Slots | None:
    """Return the formation opened by bumps, its robots moved as they must; None: some rule fails.

    Args:
        motion: of the target.
        even: what is opened.
        limits: to be kept.
        bumps: width, s, and height of those of the scale.
        widths: of the angles' bumps, to be tried.
        gains: heights of those, to be tried.
    """
    d_m, (width_s, height) = float(even.d_m), bumps
    waves = height * bump_waves(motion, d_m, limits, width_s)
    try:
        slots = moved(motion, opened(d_m, waves, even.theta_rad), limits, widths, gains)
    except InfeasibleError:
        return None
    return slots if check(motion.target, slots, limits).feasible else None


def _worth(slots: Slots, d_m: float, alpha: float) -> float:
    """Return the mean over time of the objective."""
    opening = float(np.mean(1 / d_m - 1 / np.asarray(slots.d_m)))
    moving = float(np.mean(np.abs(slots.theta_rad - slots.theta_0_rad)))
    return alpha * opening - (1 - alpha) * moving
