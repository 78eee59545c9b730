"""When to look at cameras that move about their target by themselves: where they are fastest."""

from functools import lru_cache

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.dome import dome_views
from services.planner.formation import FormationSettings
from services.planner.strategies.random import RandomSettings, drawn
from services.planner.view_file import read_views

_FLIGHTS = 64
"""So many flights of random views are looked at ahead,"""
_FASTEST = 2
"""of which so many are judged,"""
_SHARES = (0.4, 0.5, 0.6)
"""at these shares of their time: where on the arc they are fastest depends on where it leads."""


def moments(formation: FormationSettings, t_s: float) -> FloatArray:
    """Return the instants, s, from `t_s` on, at which a formation is to be judged.

    Flights are counted from the world's time 0, not from when somebody asks.

    Raises:
        PlannerError: If its view file is unusable.
    """
    settings = formation.strategy_settings()
    match formation.strategy:
        case "dome":
            path = formation.view_file
            views = len(dome_views() if path is None else read_views(path))
            # Cameras share the tour: together they fly all legs in so many.
            legs = -(-views // formation.cameras)
            leg_s = formation.dwell_s + formation.travel_s
            middle_s = formation.dwell_s + formation.travel_s / 2
            first_leg = max(float(np.ceil((t_s - middle_s) / leg_s)), 0.0)
            middles: FloatArray = (first_leg + np.arange(legs, dtype=np.float64)) * leg_s + middle_s
            return middles
        case "random":
            assert isinstance(settings, RandomSettings)
            first = int(max(t_s, 0.0) // formation.redraw_s)
            # What sets the time of a flight does not change its way.
            way = settings.model_copy(update={"redraw_s": 1.0, "radius_m": 1.0})
            fastest = [epoch + share for epoch in _longest(way, first) for share in _SHARES]
            return np.array([first, first + 0.5, first + 1.0, *fastest]) * formation.redraw_s
        case _:
            return np.array([t_s])


@lru_cache(maxsize=64)
def _longest(way: RandomSettings, first: int) -> tuple[int, ...]:
    """Return those of the next flights on which some camera goes farthest."""
    places = np.array([drawn(way, first + k) for k in range(_FLIGHTS + 1)])
    theta, elevation = np.diff(places, axis=0).swapaxes(0, 1)
    level = np.cos((places[1:, 1] + places[:-1, 1]) / 2)
    arcs = np.hypot(level * theta, elevation).max(axis=1)
    return tuple(int(first + k) for k in np.argsort(arcs)[-_FASTEST:])
