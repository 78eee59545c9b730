"""What `encircle plan` can be told; default < scenario < flag."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from schemas.camera import MAX_CAMERAS
from services.launcher.camera_limits import camera_limits
from services.launcher.errors import SettingsError
from services.launcher.layers import scenario_layer, settle
from services.launcher.settings import RunSettings
from services.planner.formation import StrategyName
from services.planner.known_motion import PathName
from services.planner.rules import Drive
from services.planner.whole_motion import ALPHA, WholeStrategy

PlanStrategy = WholeStrategy | StrategyName
PLOT_SUFFIXES = (".png", ".svg", ".pdf")
Metres = Annotated[float, Field(ge=0, le=1e4, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]


class PlanSettings(BaseModel):
    """Check a formation around a target whose motion is known, and draw it."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    scenario: Path | None = None
    """Take what follows from this scenario of `encircle run`: what is seen is the object's height
    wide, cameras are the simulated ones."""
    strategy: PlanStrategy = "circle"
    """circle: even angles at one distance; adaptive_scale: nearer in turns; constant_angles and
    adaptive_angles: other angles than even ones, for good or while they must; adaptive_both: scale
    and angles; the others as in `encircle run`."""
    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """How many cameras."""
    radius_m: Positive | None = None
    """Distance d of the cameras from the target's centre, m; the greatest that sees it from
    everywhere, if not given."""
    elevation_deg: Annotated[float, Field(ge=-85, le=85)] = 0.0
    """How far above the horizontal the centre sees its cameras; the lowest, of several."""
    top_elevation_deg: Annotated[float, Field(ge=-85, le=85)] = 60.0
    """The highest elevation of rings, sphere and random."""
    rings: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 2
    """How many rings share the cameras."""
    orbit_deg_s: Annotated[float, Field(ge=-180, le=180)] = 10.0
    """How fast the orbit turns about the target."""
    redraw_s: Annotated[float, Field(gt=0, le=3600)] = 5.0
    """Random: from one draw of the views to the next."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Random: of the draws."""
    dwell_s: Annotated[float, Field(ge=0, le=3600)] = 0.2
    """Rest at each view of the dome."""
    travel_s: Annotated[float, Field(gt=0, le=3600)] = 1.0
    """Flight between two views of the dome."""
    view_file: Path | None = None
    """Views for static and dome: lines `x y z qx qy qz qw`."""
    centre_height_m: Annotated[float, Field(ge=0, le=100)] = 0.2
    """What the cameras look at, above the target's ground point."""
    alpha: Annotated[float, Field(ge=0, le=1)] = ALPHA
    """Of adaptive_both: 0: even angles matter alone; 1: the distance alone."""
    drive: Drive = "unicycle"
    """unicycle: the camera is fixed on a robot that drives along its heading; flying: it looks at
    the target always."""

    path: PathName = "ellipse"
    """What the target drives along."""
    semi_axes_m: tuple[Positive, Positive] = (25.0, 12.6157)
    """Half lengths of the path along x and y, m; the article's."""
    lap_s: Positive = 200.0
    """Once round the path, s."""
    target_radius_m: Metres = 0.0
    """R: so much about the target's centre must be seen, m."""

    beta_deg: Annotated[float, Field(gt=0, lt=90)] = 30.0
    """Half of the camera's horizontal field of view, degrees."""
    beta_up_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    """Half of its vertical field of view, degrees; not looked at if not given."""
    margin_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    """Of it, what is kept free for noise and delay, degrees."""
    delay_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """tau: from the target's motion to that of the robots, s; the margin must allow for it."""
    bearing_noise_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    """Greatest error of a bearing by noise, degrees; the margin must allow for it."""
    range_min_m: Metres = 0.0
    """z_min: nearer than this the camera sees nothing, m."""
    range_max_m: Positive | None = None
    """Farther than this it sees nothing, m."""
    v_max_mps: Positive | None = None
    """Greatest speed of a robot, m/s."""
    omega_max_dps: Positive | None = None
    """Greatest turn rate of a robot, degrees/s."""
    robot_radius_m: Metres = 0.0
    """R_r: from the camera to the outermost point of its robot, m."""
    robot_distance_m: Metres = 0.0
    """D_min: least distance between two robots, m."""

    check: bool = False
    """Print the report; it is printed anyway."""
    json_: bool = Field(default=False, alias="json")
    """Print the report as JSON."""
    plot: Path | None = None
    """Draw the plan into this file (.png .svg .pdf)."""

    @field_validator("plot")
    @classmethod
    def _picture_format_is_known(cls, path: Path | None) -> Path | None:
        if path is not None and path.suffix not in PLOT_SUFFIXES:
            raise ValueError(f"must end with one of {' '.join(PLOT_SUFFIXES)}")
        return path

    @model_validator(mode="after")
    def _something_is_left_of_the_view(self) -> Self:
        for name in ("beta_deg", "beta_up_deg"):
            half = getattr(self, name)
            if half is not None and self.margin_deg >= half:
                raise ValueError(
                    f"margin_deg {self.margin_deg:g} leaves nothing of {name} {half:g}"
                )
        return self


def parse_plan(args: Sequence[str]) -> PlanSettings:
    """Read the settings of a plan.

    Raises:
        SettingsError: If a value breaks its rule.
        SystemExit: If a flag is unknown or help was asked for.
    """
    given = {name: value for name, value in vars(_parser().parse_args(args)).items() if value}
    path = given.get("scenario")
    known = from_scenario(Path(path)) if path else {}
    try:
        return PlanSettings.model_validate(known | given)
    except ValidationError as error:
        lines = []
        for each in error.errors():
            rule = each["msg"].removeprefix("Value error, ")
            flag = f"--{str(each['loc'][0]).replace('_', '-')}" if each["loc"] else ""
            lines.append(f"{flag} {each['input']}: {rule}" if flag else rule)
        raise SettingsError("\n".join(lines)) from error


def from_scenario(path: Path) -> dict[str, Any]:
    """Say a scenario of `encircle run` in the settings of a plan.

    Raises:
        SettingsError: If it cannot be read.
    """
    return from_run(settle([scenario_layer(path)]))


def from_run(run: RunSettings) -> dict[str, Any]:
    """Say the settings of a run in those of a plan."""
    limits = camera_limits(run)
    return {
        **{name: value for name, value in limits.items() if name != "omega_max_rps"},
        "omega_max_dps": math.degrees(limits["omega_max_rps"]),
        "strategy": run.strategy,
        "cameras": run.cameras,
        "radius_m": run.radius,
        "elevation_deg": run.elevation,
        "top_elevation_deg": run.top_elevation,
        "rings": run.rings,
        "orbit_deg_s": run.orbit,
        "redraw_s": run.redraw,
        "seed": run.seed,
        "dwell_s": run.dwell,
        "travel_s": run.travel,
        "view_file": run.view_file,
        "centre_height_m": run.height / 2,
        "drive": run.drive,
        "path": run.path,
        "semi_axes_m": run.semi_axes,
        "lap_s": run.lap,
    }


def _parser() -> argparse.ArgumentParser:
    """Return flags for all fields; their values are text, which the model judges."""
    parser = argparse.ArgumentParser(prog="encircle plan", description=PlanSettings.__doc__)
    for name, field in PlanSettings.model_fields.items():
        flag = f"--{(field.alias or name).replace('_', '-')}"
        about = " ".join((field.description or "").split())
        if field.annotation is bool:
            parser.add_argument(flag, action="store_true", help=about)
            continue
        default = "" if field.default is None else f" [{_plain(field.default)}]"
        parser.add_argument(flag, help=about + default, **_shape(name, field.annotation))
    return parser


def _shape(name: str, kind: object) -> dict[str, Any]:
    if name == "semi_axes_m":
        return {"nargs": 2, "metavar": ("A", "B")}
    kinds = (kind, *get_args(kind))
    choices = [word for each in kinds for word in get_args(each) if isinstance(word, str)]
    choices = list(dict.fromkeys(choices))
    return {"metavar": "|".join(choices) or name.rsplit("_", 1)[-1].upper()}


def _plain(default: object) -> str:
    return " ".join(map(str, default)) if isinstance(default, tuple) else str(default)
