"""What a strategy that looks ahead is told besides its settings."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from services.planner.known_motion import KnownMotion
from services.planner.rules import Drive, Limits


def no_limits(drive: Drive) -> Limits:
    """Return the limits of cameras of which nothing is known but that they see forward."""
    return Limits(beta_rad=np.pi / 2 - 1e-3, drive=drive)


@dataclass(frozen=True)
class Foreknowledge:
    """What is known before the target moves."""

    limits: Callable[[Drive], Limits] = no_limits
    """Of cameras and robots."""
    path: KnownMotion | None = None
    """A lap of the target's path, if it is known."""
