"""The reference views of all cameras at one instant."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS, CameraIndex
from schemas.feasibility import Feasibility
from schemas.geometry import Pose, Twist, Vector3
from schemas.message import Message, Name


class Reference(BaseModel):
    """Where one camera shall be, and how that view moves (world axes)."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    camera: CameraIndex
    pose: Pose
    twist: Twist


class Formation(Message):
    """What the planner wants of all cameras at the next instant."""

    strategy: Name
    centre: Vector3
    """The point all cameras look at, world."""
    radius_m: Annotated[float, Field(ge=0, le=1e3)]
    references: Annotated[tuple[Reference, ...], Field(max_length=MAX_CAMERAS)]
    polygon: Annotated[tuple[Vector3, ...], Field(max_length=MAX_CAMERAS)]
    """Corners of the formation in order, world; empty when the strategy has none."""
    feasibility: Feasibility | None = None
    """Of these references while the target moves so; None when it is not known."""
