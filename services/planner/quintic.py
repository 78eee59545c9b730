"""Moves of least jerk from any state to rest: polynomials of degree five."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from services.kernels.courses import follow
from services.kernels.rigid import FloatArray

NEVER = np.inf


def fading(tau_s: FloatArray, duration_s: FloatArray | float) -> FloatArray:
    """Return how value, rate and acceleration at the start fade until a move ends at rest at 0.

    With s = tau / T: 1 - 10 s^3 + 15 s^4 - 6 s^5, T (s - 6 s^3 + 8 s^4 - 3 s^5) and
    T^2 (s^2 - 3 s^3 + 3 s^4 - s^5) / 2; afterwards all are 0.

    Args:
        tau_s: (...) time since the start; before it the move has not begun.
        duration_s: T, broadcast against them.

    Returns:
        (3, 3, ...) derivatives 0 to 2 of the factors of value, rate and acceleration.
    """
    T = np.asarray(duration_s, np.float64)
    s = np.clip(tau_s / T, 0.0, 1.0)
    s2, s3, s4 = s * s, s**3, s**4
    left = 1 - s
    moves: FloatArray = np.array(
        [
            [
                left**3 * (1 + 3 * s + 6 * s2),
                T * left**3 * (s + 3 * s2),
                T**2 / 2 * left**3 * s2,
            ],
            [
                -30 * s2 * left**2 / T,
                1 - 18 * s2 + 32 * s3 - 15 * s4,
                T * (s - 4.5 * s2 + 6 * s3 - 2.5 * s4),
            ],
            [
                -60 * s * left * (1 - 2 * s) / T**2,
                (-36 * s + 96 * s2 - 60 * s3) / T,
                1 - 9 * s + 18 * s2 - 10 * s3,
            ],
        ]
    )
    return moves


@dataclass(frozen=True)
class Course:
    """What M quantities are going to do: a move to a goal, rest, and a move back to safety.

    Arrays (M,), in the unit of each quantity. Value, rate and acceleration are continuous.
    """

    start_s: FloatArray
    """When each began."""
    value: FloatArray
    rate: FloatArray
    push: FloatArray
    """Second derivative at the start."""
    goal: FloatArray
    safe: FloatArray
    """Where it ends."""
    move_s: FloatArray
    """Duration of the move to the goal."""
    leave_s: FloatArray
    """When the goal is left, after the start and not before it is reached; may be never."""
    back_s: FloatArray
    """Duration of the move back."""

    def except_where(self, those: NDArray[np.bool_], other: "Course") -> "Course":
        """Return these courses, but the others for those of the (M,) quantities."""
        mixed = (
            np.where(those, getattr(other, each.name), getattr(self, each.name))
            for each in fields(self)
        )
        return Course(*mixed)

    @classmethod
    def resting(cls, start_s: float, value: FloatArray) -> "Course":
        """Stay where you are."""
        zero, one = np.zeros_like(value), np.ones_like(value)
        return cls(start_s + zero, value, zero, zero, value, value, one, NEVER * one, one)

    def of(self, rows: NDArray[np.intp]) -> "Course":
        """Return some of the courses."""
        return Course(*self._rows()[:, rows])

    def replaced(self, rows: NDArray[np.intp], others: "Course") -> "Course":
        """Return these courses, but others for some of them."""
        mixed = self._rows()
        mixed[:, rows] = others._rows()
        return Course(*mixed)

    def at(self, t_s: FloatArray | float) -> FloatArray:
        """Return (3, ..., M): values, rates and accelerations at instants (...)."""
        t = np.asarray(t_s, np.float64)
        moved = np.empty((3, t.size, len(self.value)))
        follow(self._rows(), t.ravel(), moved)
        return moved.reshape(3, *t.shape, len(self.value))

    def _rows(self) -> FloatArray:
        """Return the (9, M) fields in order."""
        return np.array([getattr(self, each.name) for each in fields(self)], np.float64)
