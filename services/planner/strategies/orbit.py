"""A circle that turns about the target while the target carries it."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.planner.motion import Motion
from services.planner.plan import Plan, carried
from services.planner.ring import ring_angles
from services.planner.spherical import Spherical


class OrbitSettings(BaseModel):
    """The circle and how fast it turns, in the frame of the target."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    elevation_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    centre_height_m: Annotated[float, Field(ge=0)]
    rate_rps: float
    """Positive: against the clock, seen from above."""


class Orbit:
    """Constant scale, theta_i(t) = theta_0i + rate t: every camera sees every side in turn."""

    rests = False

    def __init__(self, settings: OrbitSettings) -> None:
        self._settings = settings
        self._centre = np.array([0.0, 0.0, settings.centre_height_m])
        self._theta_0 = ring_angles(settings.cameras)

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Carry the circle, turned as far as it is at `t_s`."""
        settings, rest = self._settings, np.zeros(self._settings.cameras)
        places = Spherical(
            range_m=rest + settings.radius_m,
            theta_rad=self._theta_0 + settings.rate_rps * t_s,
            elevation_rad=rest + settings.elevation_rad,
            range_dot=rest,
            theta_dot=rest + settings.rate_rps,
            elevation_dot=rest,
        )
        return carried(
            target, places.gazing(self._centre), self._centre, settings.radius_m, is_polygon=True
        )
