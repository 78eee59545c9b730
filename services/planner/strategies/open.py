"""The closed union of strategies."""

from typing import assert_never

from services.planner.foreknowledge import Foreknowledge
from services.planner.plan import Strategy
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.strategies.dome import Dome, DomeSettings
from services.planner.strategies.live_angles import (
    AdaptiveAnglesSettings,
    ConstantAnglesSettings,
    LiveAngles,
)
from services.planner.strategies.live_scale import LiveScale, LiveScaleSettings
from services.planner.strategies.orbit import Orbit, OrbitSettings
from services.planner.strategies.random import Random, RandomSettings
from services.planner.strategies.rings import Rings, RingsSettings
from services.planner.strategies.sphere import Sphere, SphereSettings
from services.planner.strategies.static import Static, StaticSettings

StrategySettings = (
    CircleSettings
    | RingsSettings
    | SphereSettings
    | OrbitSettings
    | RandomSettings
    | StaticSettings
    | DomeSettings
    | LiveScaleSettings
    | ConstantAnglesSettings
    | AdaptiveAnglesSettings
)
NOTHING_KNOWN = Foreknowledge()


def open_strategy(settings: StrategySettings, known: Foreknowledge = NOTHING_KNOWN) -> Strategy:
    """Build the strategy that the settings describe.

    Args:
        settings: of the strategy.
        known: to those that look ahead.

    Raises:
        PlannerError: If its view file is unusable, or its path not known.
    """
    match settings:
        case CircleSettings():
            return Circle(settings)
        case RingsSettings():
            return Rings(settings)
        case SphereSettings():
            return Sphere(settings)
        case OrbitSettings():
            return Orbit(settings)
        case RandomSettings():
            return Random(settings)
        case StaticSettings():
            return Static(settings)
        case DomeSettings():
            return Dome(settings)
        case LiveScaleSettings():
            return LiveScale(settings, known)
        case ConstantAnglesSettings() | AdaptiveAnglesSettings():
            return LiveAngles(settings, known)
        case _:
            assert_never(settings)
