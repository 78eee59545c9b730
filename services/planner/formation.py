"""What the user asks of the formation, and the strategy that it means."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self, assert_never, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from schemas.camera import MAX_CAMERAS
from services.planner.errors import PlannerError, UnknownSettingError
from services.planner.strategies.circle import CircleSettings
from services.planner.strategies.dome import DomeSettings
from services.planner.strategies.live import ForecastName
from services.planner.strategies.live_angles import AdaptiveAnglesSettings, ConstantAnglesSettings
from services.planner.strategies.live_scale import LiveScaleSettings
from services.planner.strategies.open import StrategySettings
from services.planner.strategies.orbit import OrbitSettings
from services.planner.strategies.random import RandomSettings
from services.planner.strategies.rings import RingsSettings
from services.planner.strategies.sphere import SphereSettings
from services.planner.strategies.static import StaticSettings
from services.planner.wheels import DriveName

StrategyName = Literal[
    "circle",
    "adaptive_scale",
    "constant_angles",
    "adaptive_angles",
    "rings",
    "sphere",
    "orbit",
    "random",
    "static",
    "dome",
]
_BANDS = ("rings", "sphere", "random")
"""These reach from one elevation to another."""
_WINGED = ("orbit", "random", "dome")
"""These need cameras that fly."""


Reach = Annotated[float, Field(ge=-1e4, le=1e4)]


class FormationSettings(BaseModel):
    """Flat, so that environment, flags and `ctl/planner/set` name each by one word."""

    model_config = ConfigDict(frozen=True)

    strategy: StrategyName = "circle"
    """circle: a ring around the moving target; adaptive_scale: one that opens where the way is
    straight; constant_angles, adaptive_angles: robots give way on it in turns; rings: several,
    one above the other; sphere: evenly over a cap; orbit: a ring that turns; random: views drawn
    anew every so often; static: a ring or view file at rest in the world; dome: flying from view to
    view."""
    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """How many cameras."""
    radius_m: Annotated[float, Field(gt=0, le=100)] = 1.1
    """Distance of the cameras from the centre; all but dome."""
    elevation_deg: Annotated[float, Field(ge=-85, le=85)] = 20.0
    """How far above the horizontal the centre sees its cameras; the lowest, of several."""
    top_elevation_deg: Annotated[float, Field(ge=-85, le=85)] = 60.0
    """The highest elevation of rings, sphere and random."""
    rings: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 2
    """How many rings share the cameras."""
    radius_max_m: Annotated[float, Field(gt=0, le=100)] | None = None
    """Adaptive_scale opens no farther; twice radius_m if not given."""
    forecast: ForecastName | None = None
    """Of the target, by strategies that look ahead: twist: it goes on as it does; path: along the
    known path. The path where it is known, if not given."""
    horizon_s: Annotated[float, Field(gt=0, le=600)] = 20.0
    """How far those look ahead."""
    orbit_deg_s: Annotated[float, Field(ge=-180, le=180)] = 10.0
    """How fast the orbit turns about the target; positive: against the clock from above."""
    redraw_s: Annotated[float, Field(gt=0, le=3600)] = 5.0
    """Random: from one draw of the views to the next."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Random: of the draws."""
    centre_height_m: Annotated[float, Field(ge=0, le=100)] = 0.2
    """Half the target's height: what the cameras look at, above the target's ground point."""
    centre_m: tuple[Reach, Reach] = (0.0, 0.0)
    """Middle of the static ring, x and y in the world."""
    view_file: Path | None = None
    """Lines `x y z qx qy qz qw` of the optical frame: in the world (static), in the target's
    frame (dome)."""
    dwell_s: Annotated[float, Field(ge=0, le=3600)] = 0.2
    """Rest at each view of the dome."""
    travel_s: Annotated[float, Field(gt=0, le=3600)] = 1.0
    """Flight between two views of the dome."""
    change_speed_mps: Annotated[float, Field(gt=0, le=100)] = 1.5
    """How fast cameras fly around the target, at most, when the formation changes."""
    safe_distance_m: Annotated[float, Field(ge=0, le=10)] = 0.2
    """What cameras keep from each other then; twice a body of 0.05 m and 0.05 m of air."""
    drive: DriveName = "flying"
    """flying: cameras take any view; unicycle: each is fixed on a robot with wheels."""
    infeasible: Literal["refuse", "allow"] = "refuse"
    """What becomes of a formation that breaks a rule: refuse: it is refused, with the nearest that
    is feasible; allow: it is formed, and reported as infeasible."""

    @model_validator(mode="after")
    def _cameras_stay_above_the_ground(self) -> Self:
        drop_m = self.radius_m * math.sin(math.radians(self.elevation_deg))
        if self.strategy != "dome" and self.centre_height_m + drop_m <= 0:
            raise ValueError(
                f"elevation_deg {self.elevation_deg:g} at radius_m {self.radius_m:g} puts the "
                f"cameras {-self.centre_height_m - drop_m:.3g} m below the ground"
            )
        if self.drive == "unicycle" and self.strategy in _WINGED:
            raise ValueError(
                f"drive unicycle with strategy {self.strategy}: its cameras move about the target, "
                "where one that is fixed on a robot with wheels would look away from it; known: "
                f"{', '.join(name for name in get_args(StrategyName) if name not in _WINGED)}"
            )
        if self.strategy in _BANDS and self.top_elevation_deg < self.elevation_deg:
            raise ValueError(
                f"top_elevation_deg {self.top_elevation_deg:g} is below elevation_deg "
                f"{self.elevation_deg:g}; {self.strategy} reaches from that up to it"
            )
        return self

    def goes_like(self, other: "FormationSettings") -> bool:
        """Tell whether cameras go where those of another formation do, and on the same robots."""
        return (self.drive, self.strategy_settings()) == (other.drive, other.strategy_settings())

    def strategy_settings(self) -> StrategySettings:
        """Return the settings of the strategy that is asked for."""
        elevation_rad = math.radians(self.elevation_deg)
        highest_rad = math.radians(self.top_elevation_deg)
        match self.strategy:
            case "circle":
                return CircleSettings(
                    cameras=self.cameras,
                    radius_m=self.radius_m,
                    elevation_rad=elevation_rad,
                    centre_height_m=self.centre_height_m,
                )
            case "adaptive_scale":
                most_m = 2 * self.radius_m if self.radius_max_m is None else self.radius_max_m
                return LiveScaleSettings(**self._ahead(), radius_max_m=most_m)
            case "constant_angles":
                return ConstantAnglesSettings(**self._ahead())
            case "adaptive_angles":
                return AdaptiveAnglesSettings(**self._ahead())
            case "rings":
                return RingsSettings(
                    cameras=self.cameras,
                    rings=self.rings,
                    radius_m=self.radius_m,
                    lowest_rad=elevation_rad,
                    highest_rad=highest_rad,
                    centre_height_m=self.centre_height_m,
                )
            case "sphere":
                return SphereSettings(
                    cameras=self.cameras,
                    radius_m=self.radius_m,
                    lowest_rad=elevation_rad,
                    highest_rad=highest_rad,
                    centre_height_m=self.centre_height_m,
                )
            case "orbit":
                return OrbitSettings(
                    cameras=self.cameras,
                    radius_m=self.radius_m,
                    elevation_rad=elevation_rad,
                    centre_height_m=self.centre_height_m,
                    rate_rps=math.radians(self.orbit_deg_s),
                )
            case "random":
                return RandomSettings(
                    cameras=self.cameras,
                    radius_m=self.radius_m,
                    lowest_rad=elevation_rad,
                    highest_rad=highest_rad,
                    centre_height_m=self.centre_height_m,
                    redraw_s=self.redraw_s,
                    seed=self.seed,
                )
            case "static":
                return StaticSettings(
                    cameras=self.cameras,
                    radius_m=self.radius_m,
                    elevation_rad=elevation_rad,
                    centre_m=(*self.centre_m, self.centre_height_m),
                    view_file=self.view_file,
                )
            case "dome":
                return DomeSettings(
                    cameras=self.cameras,
                    centre_height_m=self.centre_height_m,
                    view_file=self.view_file,
                    dwell_s=self.dwell_s,
                    travel_s=self.travel_s,
                )
            case _:
                assert_never(self.strategy)

    def _ahead(self) -> dict[str, Any]:
        """Return what all formations need that look ahead."""
        return {
            "cameras": self.cameras,
            "radius_m": self.radius_m,
            "elevation_rad": math.radians(self.elevation_deg),
            "centre_height_m": self.centre_height_m,
            "drive": self.drive,
            "forecast": self.forecast,
            "horizon_s": self.horizon_s,
        }

    def changed(self, params: dict[str, Any]) -> "FormationSettings":
        """Return these settings with some replaced.

        Raises:
            UnknownSettingError: If a name is not one of ours.
            PlannerError: If a value breaks its rule.
        """
        known = FormationSettings.model_fields
        if unknown := sorted(set(params) - set(known)):
            raise UnknownSettingError(f"no setting {', '.join(unknown)}; known: {', '.join(known)}")
        current = {name: getattr(self, name) for name in known}
        try:
            return FormationSettings.model_validate(current | params)
        except ValidationError as error:
            raise PlannerError("; ".join(_explain(each) for each in error.errors())) from error


def _explain(error: Any) -> str:
    place = ".".join(str(part) for part in error["loc"])
    message = str(error["msg"]).removeprefix("Value error, ")
    return f"{place} = {error['input']!r}: {message}" if place else message
