"""A camera that flies from view to view of a dome around the target."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.kernels.rigid import apply
from services.planner.dome import dome_views
from services.planner.flight import Flight
from services.planner.motion import Motion
from services.planner.plan import Plan
from services.planner.view_file import read_views


class DomeSettings(BaseModel):
    """Which views, and how long at each."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 1
    """Several cameras share the tour evenly."""
    centre_height_m: Annotated[float, Field(ge=0)]
    view_file: Path | None = None
    """Views in the frame of the target; None: the built-in dome of 48."""
    dwell_s: Annotated[float, Field(ge=0)]
    travel_s: Annotated[float, Field(gt=0)]


class Dome:
    """The single-camera experiment: predefined views, one after the other, round and round."""

    rests = False

    def __init__(self, settings: DomeSettings) -> None:
        views = dome_views() if settings.view_file is None else read_views(settings.view_file)
        self._centre = np.array([0.0, 0.0, settings.centre_height_m])
        self._flight = Flight(views, self._centre, settings.dwell_s, settings.travel_s)
        leg_s = settings.dwell_s + settings.travel_s
        share = len(views) / settings.cameras
        self._head_starts_s = np.floor(np.arange(settings.cameras) * share) * leg_s

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Return where each camera is on its tour at `t_s`."""
        local = self._flight.all_at(t_s + self._head_starts_s)
        arms = np.linalg.norm(local.T[:, :3, 3] - self._centre, axis=1)
        return Plan(
            views=target.carry(local).each(),
            centre_m=apply(target.T, self._centre),
            radius_m=float(np.mean(arms)),
            polygon_m=(),
        )
