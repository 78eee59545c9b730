"""The courses to choose from over a horizon: to a goal, and back in time to where it is safe."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.planner.quintic import NEVER, fading

NUM_STEPS = 48
"""Instants of the horizon at which rules are held."""
_SHARES = (0.0, 0.2, 0.5, 1.0)
"""Goals between the safe value and the ideal one."""
_MOVES = (0.12, 0.25, 0.45)
"""Durations of moves, of the horizon."""
_LEAVES = (0.3, 1.0)
"""How late the goal is left, of the time that there is."""
_BACKS = (0.15, 0.4)
_STOPS = (0.05, 0.15)
"""Durations of mere braking, of the horizon."""


@dataclass(frozen=True)
class Menu:
    """The C courses that are held against the rules; arrays (C,)."""

    move_s: FloatArray
    leave_s: FloatArray
    back_s: FloatArray
    goal: FloatArray
    """(C, 4): what the goal is in terms of value, rate, safe and ideal value."""
    ends_safe: NDArray[np.bool_]
    after_s: FloatArray
    """(K,) the instants of the horizon, from now on."""
    table: FloatArray
    """(2, C, K, 5): values and rates at the instants of the horizon in terms of value, rate,
    acceleration, safe and ideal value."""


def menu(horizon_s: float) -> Menu:
    """Return the courses to choose from over a horizon."""
    rows: list[tuple[float, float, float, tuple[float, float, float, float]]] = []
    for move_s in horizon_s * np.array(_MOVES):
        for share in _SHARES:
            goal = (0.0, 0.0, 1 - share, share)
            rows.append((move_s, NEVER, 1.0, goal))
            if share == 0.0:
                continue
            for back_s in horizon_s * np.array(_BACKS):
                spare_s = horizon_s - move_s - back_s
                rows += [(move_s, move_s + late * spare_s, back_s, goal) for late in _LEAVES]
    for stop_s in horizon_s * np.array(_STOPS):
        rows.append((stop_s, NEVER, 1.0, (1.0, stop_s / 2, 0.0, 0.0)))
        rows += [
            (stop_s, horizon_s - back_s, back_s, (1.0, stop_s / 2, 0.0, 0.0))
            for back_s in horizon_s * np.array(_BACKS)
        ]
    move_s, leave_s, back_s = np.array([row[:3] for row in rows]).T
    goals = np.array([row[3] for row in rows])
    after_s = steps(horizon_s)
    to = fading(after_s, move_s[:, None])
    left = fading(after_s - leave_s[:, None], back_s[:, None])[:, 0]
    whole = np.array([1.0, 0.0, 0.0])[:, None, None]
    held, returned = left - to[:, 0], whole - left
    table = np.stack(
        [
            to[:, 0] + held * goals[:, 0, None],
            to[:, 1] + held * goals[:, 1, None],
            to[:, 2],
            returned + held * goals[:, 2, None],
            held * goals[:, 3, None],
        ],
        axis=-1,
    )
    ends_safe = np.isfinite(leave_s) | (goals[:, 2] == 1.0)
    return Menu(move_s, leave_s, back_s, goals, ends_safe, after_s, table[:2])


def steps(horizon_s: float) -> FloatArray:
    """Return the (K,) instants of a horizon, from now on, s."""
    return np.linspace(0.0, horizon_s, NUM_STEPS)
