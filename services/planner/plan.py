"""What a strategy answers: one reference view per camera, and the formation they make."""

from dataclasses import dataclass
from typing import Protocol

from services.kernels.rigid import FloatArray
from services.planner.motion import Motion


@dataclass(frozen=True)
class Plan:
    """All cameras at one instant, world frame."""

    views: tuple[Motion, ...]
    """Per camera T_world_camera (optical: x right, y down, z forward) and its twist."""
    centre_m: FloatArray
    """(3,) what the cameras look at."""
    radius_m: float
    polygon_m: tuple[FloatArray, ...]
    """Corners of the formation in order; empty when the strategy has none."""


class Strategy(Protocol):
    """Where the cameras belong when the target moves so at a time."""

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Return the references for the instant `t_s` at which the target is `target`."""
        ...
