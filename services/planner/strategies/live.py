"""What formations share that look ahead while they go: memory of what they do, and settings."""

from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.kernels.rigid import FloatArray
from services.planner.errors import PlannerError
from services.planner.forecast import Ahead, Forecast, PathForecast, TwistForecast
from services.planner.foreknowledge import Foreknowledge
from services.planner.menu import steps
from services.planner.motion import Motion
from services.planner.plan import Plan, carried
from services.planner.planar import PlanarMotion
from services.planner.quintic import Course
from services.planner.rules import Drive
from services.planner.spherical import Spherical

_RESET_S = 0.25
"""Time that goes back farther was reset; less is a message that was overtaken."""

ForecastName = Literal["twist", "path"]


class LiveSettings(BaseModel):
    """A circle that gives way, in the frame of the target, and how far it looks ahead."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    elevation_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    centre_height_m: Annotated[float, Field(ge=0)]
    drive: Drive
    forecast: ForecastName | None
    """None: the path where it is known, the twist where not."""
    horizon_s: Annotated[float, Field(gt=0)]


class Planned(Protocol):
    """Where the free quantities of a formation are at an instant, and what they do next."""

    def begin(self, ahead: Ahead, t_s: float) -> Course:
        """Return where they are when nothing was before."""
        ...

    def go_on(self, former: Course, ahead: Ahead, t_s: float, turn: int) -> Course:
        """Return what they do from now on, which continues what they did; `turn` counts."""
        ...


class Memory:
    """The courses under way; safe against being asked twice, late, or out of order.

    The same instant has the same answer; with another target, too, it continues what was before
    that instant. Time that goes back farther than messages overtake each other was reset. After a
    gap in time all are where their courses have led them meanwhile.
    """

    def __init__(self, planned: Planned, forecast: Forecast, horizon_s: float) -> None:
        self._planned, self._forecast = planned, forecast
        self._after_s = steps(horizon_s)
        self._before: Course | None = None
        self._now: Course | None = None
        self._target: PlanarMotion | None = None
        self._t_s = -np.inf
        self._turn = 0

    def state(self, target: PlanarMotion, t_s: float) -> FloatArray:
        """Return (3, M) values, rates and accelerations at an instant, and plan what follows."""
        if t_s < self._t_s - _RESET_S:
            # A run after a reset is the same run: nothing is left of the one before.
            self._before = self._now = self._target = None
            self._turn, self._t_s = 0, -np.inf
            self._forecast.forget()
        elif self._now is not None and t_s < self._t_s:
            return (self._before or self._now).at(t_s)
        if t_s > self._t_s:
            if self._target is not None:
                self._forecast.saw(self._target)
            self._before = self._now
            self._turn += 1
        if self._now is None or t_s != self._t_s or target != self._target:
            ahead = self._forecast.ahead(target, self._after_s)
            if self._before is None:
                self._now = self._planned.begin(ahead, t_s)
            else:
                self._now = self._planned.go_on(self._before, ahead, t_s, self._turn)
        self._target, self._t_s = target, t_s
        return self._now.at(t_s)


def open_forecast(settings: LiveSettings, known: Foreknowledge) -> Forecast:
    """Build what the settings ask for.

    Raises:
        PlannerError: If it is a path that nobody told.
    """
    if settings.forecast == "twist" or (settings.forecast is None and known.path is None):
        return TwistForecast()
    if known.path is None:
        raise PlannerError(
            "forecast = path: no path is known (setting path of the planner); known without: twist"
        )
    return PathForecast(known.path)


def circle_plan(
    target: Motion,
    settings: LiveSettings,
    scale_m: FloatArray,
    theta_rad: FloatArray,
    psi_rad: FloatArray,
) -> Plan:
    """Plan cameras on a level circle about the target.

    Args:
        target: that carries it.
        settings: of the circle.
        scale_m: (2,) level distance and its rate.
        theta_rad: (2, N) angles on the circle and their rates.
        psi_rad: (N,) yaw of the cameras on robots that drive parallel to the target.
    """
    rest = np.zeros(settings.cameras)
    range_m, range_dot = scale_m / np.cos(settings.elevation_rad)
    places = Spherical(
        range_m=rest + range_m,
        theta_rad=theta_rad[0],
        elevation_rad=rest + settings.elevation_rad,
        range_dot=rest + range_dot,
        theta_dot=theta_rad[1],
        elevation_dot=rest,
    )
    centre = np.array([0.0, 0.0, settings.centre_height_m])
    return carried(
        target,
        places.gazing(centre),
        centre,
        float(range_m),
        is_polygon=True,
        psi_rad=psi_rad,
    )
