"""What a pilot is: which velocity a camera asks of its robot at a tick."""

from typing import NamedTuple, Protocol

from schemas.camera import CameraGoal
from schemas.geometry import Twist
from schemas.sim import CameraBody

MAX_COAST_S = 0.5
"""A reference whose planner fell silent goes on for so long and then stands still."""


class Pilot(Protocol):
    """Follows the goals of one camera."""

    def objection(self, goal: CameraGoal) -> str | None:
        """Return why the goal cannot be followed; None if it can."""
        ...

    def command(self, body: CameraBody, tick: int, goal: CameraGoal, dt_s: float) -> Twist:
        """Return the velocity for the time from `tick` to the next, world axes.

        Args:
            body: where the camera is at `tick`.
            tick: the instant at hand.
            goal: the view to hold one tick after the goal's own; an older one is moved on.
            dt_s: between two ticks.
        """
        ...


class Coast(NamedTuple):
    """How far a goal must be moved on."""

    time_s: float
    """Negative for a goal that is ahead."""
    stands: bool
    """The goal is so old that its reference has come to a stand."""


def coast(tick: int, goal_tick: int, dt_s: float) -> Coast:
    """Return how the reference of `goal_tick` is moved on to that of `tick`."""
    lag_s = (tick - goal_tick) * dt_s
    time_s = min(max(lag_s, -MAX_COAST_S), MAX_COAST_S)
    return Coast(time_s, stands=time_s != lag_s)
