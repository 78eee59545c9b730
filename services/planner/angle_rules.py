"""What angles on a circle of a given scale are held against: the field of view."""

from dataclasses import dataclass

import numpy as np

from services.kernels.circle_rules import hold_angles, rate_angles
from services.kernels.rigid import FloatArray
from services.planner.forecast import SLOWEST_MPS
from services.planner.horizon import Rated, Rows
from services.planner.planar import PlanarMotion


@dataclass(frozen=True)
class AngleRules:
    """Angles that see the target, as near as can be to those that are wished for."""

    target: PlanarMotion
    """At the K instants of the horizon."""
    wished_rad: FloatArray
    """(N,)"""
    theta_0_rad: FloatArray
    """(N,) for which the cameras are mounted."""
    d_m: float
    view_rad: float
    """Half of what they see."""

    def held(self, values: FloatArray, rates: FloatArray, rows: Rows) -> FloatArray:
        """Return how far robots look off; see `Rules`."""
        excess = np.empty_like(values)
        hold_angles(
            values,
            rates,
            self.theta_0_rad[rows],
            self.d_m,
            *self._motion(),
            self.view_rad,
            SLOWEST_MPS,
            excess,
        )
        return excess

    def worth(self, values: FloatArray, rows: Rows) -> FloatArray:
        """Return how near they come to the angles that are wished for; see `Rules`."""
        worth: FloatArray = -np.abs(values - self.wished_rad[rows]).mean(axis=0)
        return worth

    def rated(
        self,
        table: FloatArray,
        known: FloatArray,
        allowed: FloatArray,
        least: FloatArray,
        rows: Rows,
    ) -> Rated:
        """Hold courses of angles against the field of view; see `Rules`."""
        worth, fault = np.empty((2, table.shape[1], len(rows)))
        rate_angles(
            table,
            known,
            self.wished_rad[rows],
            self.theta_0_rad[rows],
            self.d_m,
            *self._motion(),
            self.view_rad,
            SLOWEST_MPS,
            allowed,
            least,
            worth,
            fault,
        )
        return Rated(worth, fault)

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        return np.asarray(self.target.v_mps), np.asarray(self.target.omega_rps)
