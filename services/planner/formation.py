"""What the user asks of the formation, and the strategy that it means."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self, assert_never

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from schemas.camera import MAX_CAMERAS
from services.planner.errors import PlannerError, UnknownSettingError
from services.planner.strategies.circle import CircleSettings
from services.planner.strategies.dome import DomeSettings
from services.planner.strategies.open import StrategySettings
from services.planner.strategies.static import StaticSettings

StrategyName = Literal["circle", "static", "dome"]


Reach = Annotated[float, Field(ge=-1e4, le=1e4)]


class FormationSettings(BaseModel):
    """Flat, so that environment, flags and `ctl/planner/set` name each by one word."""

    model_config = ConfigDict(frozen=True)

    strategy: StrategyName = "circle"
    """circle: a ring around the moving target; static: a ring or view file at rest in the world;
    dome: flying from view to view."""
    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """How many cameras."""
    radius_m: Annotated[float, Field(gt=0, le=100)] = 1.1
    """Distance of the cameras from the centre; circle and static."""
    elevation_deg: Annotated[float, Field(ge=-85, le=85)] = 20.0
    """How far above the horizontal the centre sees its cameras; circle and static."""
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

    @model_validator(mode="after")
    def _cameras_stay_above_the_ground(self) -> Self:
        drop_m = self.radius_m * math.sin(math.radians(self.elevation_deg))
        if self.strategy != "dome" and self.centre_height_m + drop_m <= 0:
            raise ValueError(
                f"elevation_deg {self.elevation_deg:g} at radius_m {self.radius_m:g} puts the "
                f"cameras {-self.centre_height_m - drop_m:.3g} m below the ground"
            )
        return self

    def strategy_settings(self) -> StrategySettings:
        """Return the settings of the strategy that is asked for."""
        elevation_rad = math.radians(self.elevation_deg)
        match self.strategy:
            case "circle":
                return CircleSettings(
                    cameras=self.cameras,
                    radius_m=self.radius_m,
                    elevation_rad=elevation_rad,
                    centre_height_m=self.centre_height_m,
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
