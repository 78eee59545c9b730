"""Strategies C and D on line: robots give way on the circle, for the turns that are known.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, cases 4 and 3, for what is ahead
only.
"""

import math

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.angle_rules import AngleRules
from services.planner.forecast import Ahead
from services.planner.foreknowledge import Foreknowledge
from services.planner.horizon import Rows, replan
from services.planner.live_feasibility import as_unicycle
from services.planner.live_rules import keeps_up
from services.planner.menu import menu
from services.planner.motion import Motion
from services.planner.plan import Plan
from services.planner.planar import yaw_offsets
from services.planner.quintic import Course
from services.planner.ring import ring_angles
from services.planner.scale_bounds import angle_bounds, edge_bearing
from services.planner.strategies.live import (
    LiveSettings,
    Memory,
    circle_plan,
    open_forecast,
)


class ConstantAnglesSettings(LiveSettings):
    """Angles that see the target in all turns that are known."""


class AdaptiveAnglesSettings(LiveSettings):
    """Angles of the regular polygon, left only while a turn asks for it."""


class LiveAngles:
    """theta_i(t) at a prescribed scale.

    Safe are the angles that see the target in every turn that is known. Robots keep to these, or,
    if adaptive, are at those of the regular polygon for as long as they can be back in time.
    """

    rests = True
    """Slowly as they move, they count as at rest while others come: where they will be, they do not
    know themselves before the target is there."""

    def __init__(
        self, settings: ConstantAnglesSettings | AdaptiveAnglesSettings, known: Foreknowledge
    ) -> None:
        self._settings = settings
        self._adaptive = isinstance(settings, AdaptiveAnglesSettings)
        self._limits = known.limits(settings.drive)
        self._menu = menu(settings.horizon_s)
        self._theta_0 = ring_angles(settings.cameras)
        self._d_m = settings.radius_m * math.cos(settings.elevation_rad)
        self._scale = np.array([self._d_m, 0.0])
        self._view = self._limits.beta_rad - float(
            edge_bearing(self._limits.target_radius_m, self._d_m)
        )
        self._memory = Memory(self, open_forecast(settings, known), settings.horizon_s)

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Carry the circle, each camera where it is on it at `t_s`."""
        state = self._memory.state(as_unicycle(target), t_s)
        return circle_plan(
            target, self._settings, self._scale, state[:2], yaw_offsets(self._theta_0)
        )

    def begin(self, ahead: Ahead, t_s: float) -> Course:
        """Start where every turn that is known will do."""
        return Course.resting(t_s, self._safe(ahead))

    def go_on(self, former: Course, ahead: Ahead, t_s: float, turn: int) -> Course:
        """Move along the circle, or stay."""
        if self._limits.drive == "flying":
            return former  # Its angles are the regular ones.
        safe = self._safe(ahead)
        wished = self._theta_0 if self._adaptive else safe
        view_rad = self._view - ahead.reserve_rad
        return replan(
            self._menu,
            t_s,
            turn,
            former,
            safe,
            wished,
            AngleRules(ahead.target, wished, self._theta_0, self._d_m, view_rad),
            keeps_up(self._limits, ahead.target, t_s + self._menu.after_s, self),
        )

    def places(self, course: Course, t_s: FloatArray, rows: Rows) -> tuple[FloatArray, FloatArray]:
        """Return scale and angles of some robots at instants (T,)."""
        scale = np.zeros((3, len(t_s)))
        scale[0] = self._d_m
        return scale, course.of(rows).at(t_s)

    def _safe(self, ahead: Ahead) -> FloatArray:
        """Return the nearest angles that will do; the middle of what is missed if none will."""
        if self._limits.drive == "flying":
            return self._theta_0
        lower, upper = angle_bounds(
            self._d_m, np.array(ahead.bends), self._view - ahead.reserve_rad, self._theta_0
        )
        middle = (lower + upper) / 2
        safe = np.where(lower <= upper, np.clip(self._theta_0, lower, upper), middle)
        return np.where(np.isfinite(safe), safe, self._theta_0)
