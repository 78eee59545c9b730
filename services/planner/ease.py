"""The timing of a smooth change."""

from typing import TypeVar

from services.kernels.rigid import FloatArray

Share = TypeVar("Share", float, FloatArray)

PEAK_RATE = 1.875
"""Greatest derivative of `ease`, at the middle."""
PEAK_ACCELERATION = 10 / 3**0.5
"""Greatest second derivative, 5.77."""


def ease(x: Share) -> tuple[Share, Share]:
    """Return minimum-jerk progress at share `x` of the time, and its derivative.

    Velocity and acceleration are zero at both ends. Source: Flash & Hogan, 1985.
    """
    return x**3 * (10 - 15 * x + 6 * x * x), 30 * x * x * (1 - x) ** 2
