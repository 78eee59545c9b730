"""How far the planner's estimate of the target was from the truth."""

import math
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from schemas.message import Message
from schemas.target import TargetEstimate, TargetPose
from services.launcher.series import Series

M = TypeVar("M", bound=Message)

_ERRORS = ("place_m", "heading_rad")
_SQUARES = tuple(f"{name}_squared" for name in _ERRORS)
_KEPT = 64
"""Instants that wait for the other half; nothing is estimated when the pose is given."""


@dataclass
class TargetErrors:
    """Pairs what was believed of an instant with what was true, in whichever order they come."""

    truths: dict[int, TargetPose] = field(default_factory=dict)
    """By tick, until its estimate comes."""
    estimates: dict[int, TargetEstimate] = field(default_factory=dict)
    """By tick."""
    errors: Series = field(default_factory=lambda: Series(*_ERRORS, *_SQUARES))
    """Of the place in metres, of the heading in radians."""
    newest: TargetEstimate | None = None
    paired_tick: int | None = None
    """Of the newest pair; one that is told again counts once."""

    def add_truth(self, truth: TargetPose) -> None:
        """Take in where the target is."""
        _keep(self.truths, truth)
        self._pair(truth.tick)

    def add_estimate(self, estimate: TargetEstimate) -> None:
        """Take in where the planner thinks it is."""
        self.newest = estimate
        _keep(self.estimates, estimate)
        self._pair(estimate.tick)

    def report(self) -> dict[str, Any] | None:
        """Return the errors and what the estimate rests on; None if nothing was estimated."""
        if not len(self.errors) or self.newest is None:
            return None
        return {
            **{name: _figures(self.errors, name) for name in _ERRORS},
            "instants": len(self.errors),
            "used": self.newest.num_used,
            "refused": self.newest.num_refused,
            "missed": self.newest.num_missed,
        }

    def _pair(self, tick: int) -> None:
        if tick not in self.truths or tick not in self.estimates:
            return
        truth, estimate = self.truths.pop(tick).pose, self.estimates.pop(tick).pose
        turned = np.linalg.inv(truth.matrix()) @ estimate.matrix()
        place_m = math.dist(truth.position[:2], estimate.position[:2])
        heading_rad = abs(math.atan2(turned[1, 0], turned[0, 0]))
        put = self.errors.correct if tick == self.paired_tick else self.errors.add
        put(place_m, heading_rad, place_m**2, heading_rad**2)
        self.paired_tick = tick


def _keep(held: dict[int, M], message: M) -> None:
    held[message.tick] = message
    while len(held) > _KEPT:
        del held[next(iter(held))]


def _figures(errors: Series, name: str) -> dict[str, float]:
    return {
        "rms": math.sqrt(errors.figures(f"{name}_squared")["mean"]),
        "p95": errors.percentile(name, 95),
        "max": errors.figures(name)["max"],
    }
