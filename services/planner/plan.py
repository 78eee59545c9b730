"""What a strategy answers: one reference view per camera, and the formation they make."""

from dataclasses import dataclass
from typing import Protocol

from services.kernels.rigid import FloatArray, apply
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
    psi_rad: FloatArray | None = None
    """(N,) yaw of each camera on a robot that drives parallel to the target; None: such that it
    looks where its view does when the robot is built."""


def carried(
    target: Motion,
    local: Motion,
    centre_m: FloatArray,
    radius_m: float,
    *,
    is_polygon: bool,
    psi_rad: FloatArray | None = None,
) -> Plan:
    """Plan N views that are given, as one motion, in the frame of the target.

    Args:
        centre_m: (3,) what the cameras look at, frame of the target.
        is_polygon: whether the views in order are the corners of one.
        psi_rad: how cameras are turned on robots, if not as the views look.
    """
    views = target.carry(local).each()
    return Plan(
        views=views,
        centre_m=apply(target.T, centre_m),
        radius_m=radius_m,
        polygon_m=tuple(view.T[:3, 3] for view in views) if is_polygon else (),
        psi_rad=psi_rad,
    )


class Strategy(Protocol):
    """Where the cameras belong when the target moves so at a time."""

    rests: bool
    """Whether all views rest in the frame of the target."""

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Return the references for the instant `t_s` at which the target is `target`."""
        ...
