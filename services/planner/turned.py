"""A formation turned about its target: with fewer cameras than asked for, none has far to go."""

from typing import assert_never

import numpy as np

from services.kernels.rigid import planar
from services.planner.assignment import assign, sharpened, travel
from services.planner.course import Course
from services.planner.motion import Motion
from services.planner.pace import Pace, Ways, time_needed
from services.planner.plan import Plan, Strategy
from services.planner.strategies.circle import CircleSettings
from services.planner.strategies.dome import DomeSettings
from services.planner.strategies.live_angles import AdaptiveAnglesSettings, ConstantAnglesSettings
from services.planner.strategies.live_scale import LiveScaleSettings
from services.planner.strategies.open import StrategySettings
from services.planner.strategies.orbit import OrbitSettings
from services.planner.strategies.random import RandomSettings
from services.planner.strategies.rings import RingsSettings
from services.planner.strategies.sphere import SphereSettings
from services.planner.strategies.static import StaticSettings

_FEW, _MOST_TURNS, _LEAST_TURNS = 16, 72, 24
"""So many turns are tried; the fewer with more cameras than a few, as these stand close."""
_TIMED = 6
"""So many turns, those with the shortest longest way, are compared by the time they take."""


class Turned:
    """A strategy's views, turned about the vertical axis of the target."""

    def __init__(self, strategy: Strategy, turn_rad: float) -> None:
        self.rests = strategy.rests
        self._strategy, self._T = strategy, planar(0.0, 0.0, turn_rad)

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Plan for a target that heads elsewhere, and moves and turns as this one does."""
        return self._strategy.plan(Motion(target.T @ self._T, target.linear, target.angular), t_s)


def turns_freely(settings: StrategySettings) -> bool:
    """Tell whether a formation is as good in whatever direction it is turned."""
    match settings:
        case CircleSettings() | RingsSettings() | SphereSettings() | OrbitSettings():
            return True
        case RandomSettings() | StaticSettings() | DomeSettings():
            return False  # Their views are given, or drawn, where they are.
        case LiveScaleSettings() | ConstantAnglesSettings() | AdaptiveAnglesSettings():
            return False  # The direction in which the target drives matters.
        case _:
            assert_never(settings)


def nearest_turn(start: Course, end: Course, pace: Pace) -> float:
    """Return by how much to turn the places so that their cameras are soonest there, rad.

    Args:
        start: (N,) where the cameras are.
        end: (N,) the places as they are, for whomever.
        pace: of cameras.
    """
    num_turns = _MOST_TURNS if len(start.range_m) <= _FEW else _LEAST_TURNS
    turns_rad = np.linspace(-np.pi, np.pi, num_turns, endpoint=False)
    turned = [Course(end.range_m, end.theta_rad + turn, end.climb_m) for turn in turns_rad]
    ordered, longest = [], []
    for each in turned:
        costs = travel(start, each)
        columns = assign(sharpened(costs))
        longest.append(np.max(costs[np.arange(len(columns)), columns]))
        ordered.append(
            Course(each.range_m[columns], each.theta_rad[columns], each.climb_m[columns])
        )
    best = np.argsort(longest, kind="stable")[:_TIMED]
    rest = np.zeros_like(start.range_m)
    times_s = [time_needed(Ways.straight(start, ordered[k]), 0.0, rest, rest, pace) for k in best]
    return float(turns_rad[best[np.argmin(times_s)]])
