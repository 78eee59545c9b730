"""What one look is worth: OctoMap's inverse sensor model, in fixed point."""

import math
from dataclasses import dataclass

from services.mapper.errors import BadSensorModel

LOG_ODDS_SCALE = 8192
"""Fixed point units per unit of log-odds; an update is exact to 1e-4."""
_HIGHEST_LOG_ODDS = 32767 / LOG_ODDS_SCALE


def log_odds(probability: float) -> float:
    """Return ln(p / (1 - p))."""
    return math.log(probability / (1.0 - probability))


@dataclass(frozen=True)
class SensorModel:
    """Probabilities of occupancy; the defaults are OctoMap's (Hornung et al., 2013).

    Raises:
        BadSensorModel: If they are not ordered min < miss < 0.5 < hit < max, or beyond int16.
    """

    hit: float = 0.7
    miss: float = 0.4
    min: float = 0.1192
    max: float = 0.971

    def __post_init__(self) -> None:
        """Check the order and the range of the probabilities."""
        if not 0.0 < self.min < self.miss < 0.5 < self.hit < self.max < 1.0:
            raise BadSensorModel(
                f"min {self.min}, miss {self.miss}, hit {self.hit}, max {self.max}; "
                "they must satisfy 0 < min < miss < 0.5 < hit < max < 1"
            )
        for name, value in (("min", self.min), ("max", self.max)):
            if abs(log_odds(value)) > _HIGHEST_LOG_ODDS:
                raise BadSensorModel(
                    f"{name} {value} must lie in 0.0180 .. 0.9820 (int16 log-odds)"
                )

    def fixed_point(self) -> tuple[int, int, int, int]:
        """Return hit, miss, min, max as log-odds in 1/8192."""
        hit, miss, low, high = (
            round(log_odds(p) * LOG_ODDS_SCALE) for p in (self.hit, self.miss, self.min, self.max)
        )
        return hit, miss, low, high
