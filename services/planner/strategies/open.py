"""The closed union of strategies."""

from typing import assert_never

from services.planner.plan import Strategy
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.strategies.dome import Dome, DomeSettings
from services.planner.strategies.static import Static, StaticSettings

StrategySettings = CircleSettings | StaticSettings | DomeSettings


def open_strategy(settings: StrategySettings) -> Strategy:
    """Build the strategy that the settings describe.

    Raises:
        PlannerError: If its view file is unusable.
    """
    match settings:
        case CircleSettings():
            return Circle(settings)
        case StaticSettings():
            return Static(settings)
        case DomeSettings():
            return Dome(settings)
        case _:
            assert_never(settings)
