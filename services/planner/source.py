"""What references come from: a formation, or a change that leads to one."""

from collections.abc import Sequence
from typing import Protocol

from services.kernels.rigid import FloatArray
from services.planner.motion import Motion


class Source(Protocol):
    """Where references come from."""

    cameras: tuple[int, ...]

    def at(self, target: Motion, t_s: float) -> Motion:
        """Return the views of `cameras`, (N, 4, 4) in the frame of the target, and twists."""
        ...

    def eyes(self, targets: Sequence[Motion], times_s: Sequence[float]) -> FloatArray:
        """Return (S, N, 3) where the cameras will be at S instants, frame of the target then.

        Looking ahead changes nothing: what `at` remembers stays as it is.
        """
        ...
