"""Strategy B on line: the formation opens as far as it can close again in time.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, case 1, for what is ahead only.
"""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from services.kernels.rigid import FloatArray
from services.planner.forecast import Ahead
from services.planner.foreknowledge import Foreknowledge
from services.planner.horizon import Rows, replan
from services.planner.live_feasibility import as_unicycle
from services.planner.live_rules import keeps_up, least_scale
from services.planner.menu import menu
from services.planner.motion import Motion
from services.planner.plan import Plan
from services.planner.planar import yaw_offsets
from services.planner.quintic import Course
from services.planner.ring import ring_angles
from services.planner.scale_bounds import finite_set_scale, scale_range
from services.planner.scale_rules import ScaleRules
from services.planner.strategies.live import (
    LiveSettings,
    Memory,
    circle_plan,
    open_forecast,
)


class LiveScaleSettings(LiveSettings):
    """The circle: `radius_m` is what it has in the sharpest turn."""

    radius_max_m: Annotated[float, Field(gt=0)]
    """It opens no farther."""


class LiveScale:
    """d(t) of a regular polygon, the greatest over the horizon that every rule allows.

    At rest it is as wide as asked for, or as the sharpest turn allows that is known.
    """

    rests = True
    """Slowly as they move, they count as at rest while others come: where they will be, they do not
    know themselves before the target is there."""

    def __init__(self, settings: LiveScaleSettings, known: Foreknowledge) -> None:
        self._settings = settings
        self._limits = known.limits(settings.drive)
        self._menu = menu(settings.horizon_s)
        self._theta_0 = ring_angles(settings.cameras)
        self._angles = np.stack([self._theta_0, np.zeros(settings.cameras)])
        level = math.cos(settings.elevation_rad)
        self._base_m = settings.radius_m * level
        self._floor_m = min(least_scale(self._limits, self._theta_0), self._base_m)
        far_m = self._limits.range_max_m
        most_m = settings.radius_max_m if far_m is None else far_m - self._limits.target_radius_m
        self._most_m = max(min(settings.radius_max_m, most_m) * level, self._base_m)
        self._memory = Memory(self, open_forecast(settings, known), settings.horizon_s)

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Carry the circle, as wide as it is at `t_s`."""
        state = self._memory.state(as_unicycle(target), t_s)
        return circle_plan(
            target, self._settings, state[:2, 0], self._angles, yaw_offsets(self._theta_0)
        )

    def begin(self, ahead: Ahead, t_s: float) -> Course:
        """Start as wide as the sharpest turn allows."""
        return Course.resting(t_s, self._safe(ahead))

    def go_on(self, former: Course, ahead: Ahead, t_s: float, turn: int) -> Course:
        """Open, stay or close."""
        return replan(
            self._menu,
            t_s,
            turn,
            former,
            self._safe(ahead),
            np.array([self._most_m]),
            self._rules(ahead),
            keeps_up(self._limits, ahead.target, t_s + self._menu.after_s, self),
        )

    def places(self, course: Course, t_s: FloatArray, rows: Rows) -> tuple[FloatArray, FloatArray]:
        """Return scale and angles of all robots at instants (T,): they move as one."""
        del rows
        theta = np.zeros((3, len(t_s), len(self._theta_0)))
        theta[0] = self._theta_0
        return np.ascontiguousarray(course.at(t_s)[..., 0]), theta

    def _safe(self, ahead: Ahead) -> FloatArray:
        limits, kappa = self._limits, ahead.bends.sharpest
        beta = limits.beta_rad - ahead.reserve_rad
        if limits.drive == "flying":
            return np.array([self._base_m])
        allowed = scale_range(beta, kappa, limits.target_radius_m)
        greatest_m = self._base_m if allowed is None else allowed[1]
        if limits.target_radius_m == 0:
            greatest_m = finite_set_scale(beta, kappa, self._theta_0)
        return np.array([max(min(self._base_m, greatest_m), self._floor_m)])

    def _rules(self, ahead: Ahead) -> ScaleRules:
        limits = self._limits
        beta = limits.beta_rad - ahead.reserve_rad
        return ScaleRules(
            ahead.target,
            least_m=self._floor_m,
            most_m=self._most_m,
            v_max_mps=np.inf if limits.v_max_mps is None else limits.v_max_mps,
            beta_rad=beta if limits.drive == "unicycle" else np.inf,
            target_radius_m=limits.target_radius_m,
            cameras=self._settings.cameras,
        )
