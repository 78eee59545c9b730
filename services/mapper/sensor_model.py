"""What one look is worth: OctoMap's inverse sensor model, in fixed point."""

import math
from dataclasses import dataclass
from typing import Self

from services.mapper.errors import BadSensorModel

LOG_ODDS_SCALE = 8192
"""Fixed point units per unit of log-odds; an update is exact to 1e-4."""
_HIGHEST_LOG_ODDS = 32767 / LOG_ODDS_SCALE
_NEAREST = 0.125 / LOG_ODDS_SCALE
"""From even odds, of a probability that is not rounded to them."""
_WIDEST = 32760
"""Widest clamp that `with_frames` takes, 1/8192: a little less than int16 holds."""
MOST_FRAMES = 1000
"""Beyond it an update is so small that rounding matters (33 units; the law has half of them)."""


def log_odds(probability: float) -> float:
    """Return ln(p / (1 - p))."""
    return math.log(probability / (1.0 - probability))


def probability(log_odds: float) -> float:
    """Return 1 / (1 + exp(-log_odds)), the inverse of `log_odds`."""
    return 1.0 / (1.0 + math.exp(-log_odds))


@dataclass(frozen=True)
class SensorModel:
    """Probabilities of occupancy; the defaults are OctoMap's (Hornung et al., 2013).

    A clamp may be nearer than one update: then one look says all there is to say.

    Raises:
        BadSensorModel: If they do not separate at 0.5, also in 1/8192, or are beyond int16.
    """

    hit: float = 0.7
    miss: float = 0.4
    min: float = 0.1192
    max: float = 0.971

    def __post_init__(self) -> None:
        """Check the order and the range of the probabilities."""
        if not (0.0 < self.min < 0.5 < self.max < 1.0 and 0.0 < self.miss < 0.5 < self.hit < 1.0):
            raise BadSensorModel(
                f"min {self.min}, miss {self.miss}, hit {self.hit}, max {self.max}; "
                "they must satisfy 0 < min, miss < 0.5 < hit, max < 1"
            )
        for name in ("hit", "miss", "min", "max"):
            if abs(log_odds(getattr(self, name))) > _HIGHEST_LOG_ODDS:
                raise BadSensorModel(
                    f"{name} {getattr(self, name)} must lie in 0.0180 .. 0.9820 (int16 log-odds)"
                )
        hit, miss, low, _ = self.fixed_point()
        if not (miss < 0 < hit and low < 0):
            raise BadSensorModel(
                f"min {self.min}, miss {self.miss}, hit {self.hit} must differ from 0.5 by "
                f"{_NEAREST:.2g} at least (log-odds are kept in 1/{LOG_ODDS_SCALE})"
            )

    @classmethod
    def from_frames(
        cls, frames_to_clear: int | None = None, frames_to_appear: int | None = None
    ) -> Self:
        """Return OctoMap's model with clamps that are crossed in so many frames.

        Raises:
            BadSensorModel: See `with_frames`.
        """
        return cls().with_frames(frames_to_clear, frames_to_appear)

    def with_frames(
        self, frames_to_clear: int | None = None, frames_to_appear: int | None = None
    ) -> Self:
        """Return this model with clamps that are crossed in so many frames.

        A voxel seen often stands at a clamp. With clamp M > 0 and misses of -m it holds M - j m
        after j misses and is occupied while that is >= 0, so it turns free at the k-th miss iff

            (k - 1) m <= M < k m,

        and with clamp -L and hits of h it turns occupied at the a-th hit iff
        (a - 1) h < L <= a h. Taken are the middles, M = (k - 1/2) m and L = (a - 1/2) h: half an
        update is to spare for rounding. A voxel between the clamps turns sooner, an unknown one at
        its first look; several cameras in a frame only make it faster. Updates stay as they are
        unless a clamp would leave int16: then m = 4 / (k - 1/2), about. (OctoMap's own numbers are
        9 frames to clear and 3 to appear.)

        Args:
            frames_to_clear: k, 1 .. 1000; sets `miss` and `max`. None leaves them.
            frames_to_appear: a, 1 .. 1000; sets `hit` and `min`. None leaves them.

        Raises:
            BadSensorModel: If a number of frames is out of its range.
        """
        hit, miss, low, high = self.hit, self.miss, self.min, self.max
        if frames_to_clear is not None:
            step, clamp = _crossed_in("frames_to_clear", frames_to_clear, -log_odds(miss))
            miss, high = probability(-step), probability(clamp)
        if frames_to_appear is not None:
            step, clamp = _crossed_in("frames_to_appear", frames_to_appear, log_odds(hit))
            hit, low = probability(step), probability(-clamp)
        return type(self)(hit, miss, low, high)

    def fixed_point(self) -> tuple[int, int, int, int]:
        """Return hit, miss, min, max as log-odds in 1/8192."""
        hit, miss, low, high = (
            round(log_odds(p) * LOG_ODDS_SCALE) for p in (self.hit, self.miss, self.min, self.max)
        )
        return hit, miss, low, high


def _crossed_in(name: str, frames: int, update: float) -> tuple[float, float]:
    """Return an update of at most a size (log-odds), and the clamp that so many of it cross."""
    if not 1 <= frames <= MOST_FRAMES:
        raise BadSensorModel(f"{name} {frames} must lie in 1 .. {MOST_FRAMES}")
    # In whole units, so that rounding cannot add up.
    step = min(round(update * LOG_ODDS_SCALE), 2 * _WIDEST // (2 * frames - 1))
    return step / LOG_ODDS_SCALE, (2 * frames - 1) * step // 2 / LOG_ODDS_SCALE
