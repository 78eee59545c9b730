"""The instant at which a change begins."""

from collections.abc import Sequence
from typing import NamedTuple

from services.kernels.rigid import FloatArray
from services.planner.course import Course
from services.planner.motion import Motion
from services.planner.source import Source


class Here(NamedTuple):
    """When, where the target is, and what ways lead around."""

    target: Motion
    """How it moves; it is taken to go on so."""
    t_s: float
    centre_m: FloatArray
    """(3,) frame of the target."""

    def course(self, source: Source) -> Course:
        """Return (N,) where the cameras of a source are now."""
        return Course.to(source.eyes([self.target], [self.t_s])[0] - self.centre_m)

    def courses(self, source: Source, delays_s: Sequence[float]) -> Course:
        """Return (S, N) where they will be so much later."""
        targets = [self.target.predicted(delay_s) for delay_s in delays_s]
        eyes = source.eyes(targets, [self.t_s + delay_s for delay_s in delays_s])
        return Course.to(eyes - self.centre_m)
