"""Constant scale: N cameras on a circle that moves and turns with the target."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.planner.motion import Motion, still
from services.planner.plan import Plan, carried
from services.planner.ring import ring_views


class CircleSettings(BaseModel):
    """The circle, in the frame of the target."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    elevation_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    centre_height_m: Annotated[float, Field(ge=0)]
    """The target's centre above its ground point."""


class Circle:
    """Strategy A of Lopez-Nicolas, Aranda, Mezouar, T-RO 36(1), 2020, raised by an elevation.

    Radius and angles are constant in the frame of the target, so the formation is a rigid body
    that the target carries: q_i = q_t + R_t d_i, v_i = v_t + w_t x R_t d_i, w_i = w_t.
    """

    rests = True

    def __init__(self, settings: CircleSettings) -> None:
        self._radius_m = settings.radius_m
        self._centre = np.array([0.0, 0.0, settings.centre_height_m])
        views = ring_views(
            settings.cameras, settings.radius_m, settings.elevation_rad, self._centre
        )
        self._local = still(np.array(views))

    def plan(self, target: Motion, t_s: float) -> Plan:  # noqa: ARG002 the circle never changes.
        """Carry the ring of cameras along with the target."""
        return carried(target, self._local, self._centre, self._radius_m, is_polygon=True)
