"""Sums of Gaussian bumps over time: smooth, with exact derivatives."""

import math

import numpy as np

from services.kernels.rigid import FloatArray

_FELT_WIDTHS = 6.0
"""Farther than so many widths from its middle a bump is below 2e-8 of its height."""


def bump_sum(
    t_s: FloatArray,
    centres_s: FloatArray,
    heights: FloatArray,
    width_s: float,
    period_s: float | None = None,
) -> FloatArray:
    """Return (3, T): sum over b of heights_b exp(-(t - b)^2 / (2 width^2)) and two derivatives.

    Args:
        t_s: (T,) instants.
        centres_s: (B,) middles b of the bumps.
        heights: (B,) of the bumps, or (B, N) of those of N robots: then (3, T, N) is returned.
        width_s: their standard deviation c.
        period_s: every bump comes again after so long and has come before; None: once.
    """
    if period_s is not None:
        reach = math.ceil(_FELT_WIDTHS * width_s / period_s)
        laps = np.arange(-reach, reach + 1) * period_s
        centres_s = (laps[:, None] + centres_s).ravel()
        heights = np.concatenate([heights] * len(laps))
    away = (t_s[:, None] - centres_s) / width_s
    bell = np.exp(-0.5 * away**2)
    return np.stack(
        [
            bell @ heights,
            (-away / width_s * bell) @ heights,
            ((away**2 - 1) / width_s**2 * bell) @ heights,
        ]
    )


def bump_centres(t_s: FloatArray, num_steps: int, *, closed: bool = False) -> FloatArray:
    """Return (num_steps + 1,) middles, even from the first instant to the last.

    Args:
        t_s: (T,) instants.
        num_steps: between the middles.
        closed: the last instant is the first again, and its bump, too: it is left out.
    """
    centres = np.linspace(t_s[0], t_s[-1], num_steps + 1)
    return centres[:-1] if closed else centres
