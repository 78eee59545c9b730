"""What the scale of a regular polygon is held against: bounds, speed, and the field of view."""

from dataclasses import dataclass

import numpy as np

from services.kernels.circle_rules import hold_scale, rate_scale
from services.kernels.rigid import FloatArray
from services.planner.forecast import SLOWEST_MPS
from services.planner.horizon import Rated, Rows
from services.planner.planar import PlanarMotion

_ROUNDING_M = 1e-9


@dataclass(frozen=True)
class ScaleRules:
    """Scales at which the target is seen, as wide as can be."""

    target: PlanarMotion
    """At the K instants of the horizon."""
    least_m: float
    most_m: float
    v_max_mps: float
    """Infinite if there is no limit."""
    beta_rad: float
    """Half of what cameras see; infinite if they turn to the target by themselves."""
    target_radius_m: float
    cameras: int

    def held(self, values: FloatArray, rates: FloatArray, rows: Rows) -> FloatArray:
        """Return by how much scales break a rule; see `Rules`."""
        del rows  # There is but one scale.
        excess = np.empty_like(values)
        hold_scale(
            values, rates, *self._motion(), self._bounds(), self.cameras, SLOWEST_MPS, excess
        )
        return excess

    def worth(self, values: FloatArray, rows: Rows) -> FloatArray:
        """Return the mean scale; see `Rules`."""
        del rows
        worth: FloatArray = values.mean(axis=0)
        return worth

    def rated(
        self,
        table: FloatArray,
        known: FloatArray,
        allowed: FloatArray,
        least: FloatArray,
        rows: Rows,
    ) -> Rated:
        """Hold courses of scales against the rules; see `Rules`."""
        del rows
        worth, fault = np.empty((2, table.shape[1], 1))
        rate_scale(
            table,
            known,
            *self._motion(),
            self._bounds(),
            self.cameras,
            SLOWEST_MPS,
            allowed,
            least,
            worth,
            fault,
        )
        return Rated(worth, fault)

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        return np.asarray(self.target.v_mps), np.asarray(self.target.omega_rps)

    def _bounds(self) -> tuple[float, float, float, float, float]:
        most_m = self.most_m + _ROUNDING_M
        return self.least_m, most_m, self.v_max_mps, self.beta_rad, self.target_radius_m
