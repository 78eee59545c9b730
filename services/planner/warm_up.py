"""Runs every kernel of the planner once, so that numba compiles or loads it now."""

import numpy as np

from services.planner.assignment import assign
from services.planner.course import Course
from services.planner.detours import detours
from services.planner.foreknowledge import Foreknowledge
from services.planner.formation import FormationSettings
from services.planner.live_rules import keeps_up
from services.planner.motion import still
from services.planner.planar import PlanarMotion
from services.planner.quintic import Course as LiveCourse
from services.planner.rules import Drive, Limits
from services.planner.strategies.live_angles import LiveAngles
from services.planner.strategies.open import open_strategy


def warm_up() -> None:
    """Send two cameras to each other's places, with the types that real ones have."""
    assign(np.eye(2))
    share = np.linspace(0.0, 1.0, 3)
    theta = np.stack([share, 1.0 - share], axis=1)
    detours(Course(np.ones((3, 2)), theta, np.zeros((3, 2))), share, 0.1)
    _look_ahead()


def _look_ahead() -> None:
    """Plan two instants of the formations that look ahead, and hold a course against a limit."""
    for name in ("adaptive_scale", "adaptive_angles"):
        settings = FormationSettings(cameras=2, drive="unicycle").changed({"strategy": name})
        strategy = open_strategy(settings.strategy_settings(), Foreknowledge(_limits))
        for t_s in (0.0, 0.1):
            strategy.plan(still(np.eye(4)), t_s)
    assert isinstance(strategy, LiveAngles)
    rest = np.zeros(2)
    verify = keeps_up(_limits("unicycle"), PlanarMotion(*[rest] * 7), rest, strategy)
    assert verify is not None
    verify(LiveCourse.resting(0.0, rest), np.arange(2))


def _limits(drive: Drive) -> Limits:
    return Limits(beta_rad=0.5, drive=drive, v_max_mps=1.0)
