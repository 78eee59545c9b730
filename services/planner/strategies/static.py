"""Cameras that stand still in the world: a ring, or the views of a file."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.planner.errors import PlannerError
from services.planner.motion import Motion, still
from services.planner.plan import Plan
from services.planner.ring import ring_views
from services.planner.view_file import read_views


class StaticSettings(BaseModel):
    """Where the cameras stand, world frame."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    elevation_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    centre_m: tuple[float, float, float]
    view_file: Path | None = None
    """Take the first views of this file instead of the ring."""


class Static:
    """A rig on the wall: the same views, whatever the target does."""

    rests = False

    def __init__(self, settings: StaticSettings) -> None:
        centre = np.asarray(settings.centre_m, np.float64)
        views = (
            ring_views(settings.cameras, settings.radius_m, settings.elevation_rad, centre)
            if settings.view_file is None
            else read_views(settings.view_file)
        )
        if len(views) < settings.cameras:
            raise PlannerError(
                f"{settings.view_file}: {len(views)} views for {settings.cameras} cameras; "
                "static needs a view per camera"
            )
        views = views[: settings.cameras]
        eyes = tuple(view[:3, 3] for view in views)
        self._plan = Plan(
            views=tuple(still(view) for view in views),
            centre_m=centre,
            radius_m=float(np.mean([np.linalg.norm(eye - centre) for eye in eyes])),
            polygon_m=eyes if settings.view_file is None else (),
        )

    def plan(self, target: Motion, t_s: float) -> Plan:  # noqa: ARG002 nothing moves it.
        """Return the same views always."""
        return self._plan
