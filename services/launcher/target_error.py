"""How far the planner's estimate of the target was from the truth."""

import math
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from schemas.message import Message
from schemas.target import TargetEstimate, TargetPose

M = TypeVar("M", bound=Message)

_KEPT = 64
"""Instants that wait for the other half; nothing is estimated when the pose is given."""


@dataclass
class TargetErrors:
    """Pairs what was believed of an instant with what was true, in whichever order they come."""

    truths: dict[int, TargetPose] = field(default_factory=dict)
    """By tick, until its estimate comes."""
    estimates: dict[int, TargetEstimate] = field(default_factory=dict)
    """By tick."""
    errors: dict[int, tuple[float, float]] = field(default_factory=dict)
    """By tick: of the place in metres, of the heading in radians."""
    newest: TargetEstimate | None = None

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
        if not self.errors or self.newest is None:
            return None
        place, heading = np.array(list(self.errors.values())).T
        return {
            "place_m": _figures(place),
            "heading_rad": _figures(heading),
            "instants": len(place),
            "used": self.newest.num_used,
            "refused": self.newest.num_refused,
            "missed": self.newest.num_missed,
        }

    def _pair(self, tick: int) -> None:
        if tick not in self.truths or tick not in self.estimates:
            return
        truth, estimate = self.truths.pop(tick).pose, self.estimates.pop(tick).pose
        turned = np.linalg.inv(truth.matrix()) @ estimate.matrix()
        self.errors[tick] = (
            math.dist(truth.position[:2], estimate.position[:2]),
            abs(math.atan2(turned[1, 0], turned[0, 0])),
        )


def _keep(held: dict[int, M], message: M) -> None:
    held[message.tick] = message
    while len(held) > _KEPT:
        del held[next(iter(held))]


def _figures(values: Any) -> dict[str, float]:
    return {
        "rms": float(np.sqrt(np.mean(np.square(values)))),
        "p95": float(np.percentile(values, 95)),
        "max": float(np.max(values)),
    }
