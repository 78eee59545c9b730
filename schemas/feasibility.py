"""Whether a formation can be driven and keeps its target in view, and by how much."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from schemas.message import Name

_FROZEN = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class Rule(BaseModel):
    """One inequality that a formation must obey, with its two sides as they are."""

    model_config = _FROZEN

    name: Name
    inequality: Annotated[str, Field(max_length=128)]
    """In the symbols of the article, `value` on the left of `limit`."""
    sense: Literal["<=", ">="]
    value: float
    limit: float
    unit: Literal["rad", "m", "m/s", "rad/s"]
    holds: bool


class RobotNeeds(BaseModel):
    """What a formation asks of one robot."""

    model_config = _FROZEN

    theta_rad: float
    """Its angle on the circle at the first instant."""
    bearing_rad: float
    """The greatest angle by which its camera sees the target's centre off its axis."""
    margin_rad: float
    """How far the target's edge stays within the field of view; negative when it leaves."""
    share_in_view: Annotated[float, Field(ge=0, le=1)]
    """Of the instants, those at which the whole target is in view."""
    v_min_mps: float
    """Slowest along the heading; negative is backwards."""
    v_max_mps: float
    omega_rps: float
    """Greatest turn rate to either side."""


class Feasibility(BaseModel):
    """The report on one formation for one motion of the target."""

    model_config = _FROZEN

    feasible: bool
    kappa_max_1pm: float | None
    """Greatest curvature of the target's path, 1/m; None when it turns on the spot."""
    critical_scale_m: float | None
    """d_c = sin(beta) / kappa_max; None when any scale will do."""
    finite_set_scale_m: float | None
    """The same for these N cameras alone; None when any scale will do."""
    least_scale_m: float | None
    """Least scale at which any camera would see the whole target; None when there is none."""
    greatest_scale_m: float | None
    """The greatest; None when there is none or any greater scale will do."""
    robots_apart_m: float | None
    """Least distance between two robots; None for a single one."""
    target_apart_m: float
    """Least distance of a robot from the target's centre."""
    rules: Annotated[tuple[Rule, ...], Field(max_length=16)]
    robots: Annotated[tuple[RobotNeeds, ...], Field(max_length=MAX_CAMERAS)]
