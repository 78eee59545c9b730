"""Where the target is: known, as a tracker sees it, and as it is estimated."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from schemas.geometry import Pose, Twist
from schemas.message import Message, Nanoseconds

Sigma = Annotated[float, Field(ge=0, le=1e3)]
"""Standard deviation."""
Count = Annotated[int, Field(ge=0)]


class TargetPose(Message):
    """`target` in `world`: origin on the ground below the target, x forward, z up."""

    pose: Pose
    twist: Twist
    """World axes."""


class Sighting(BaseModel):
    """One measurement of the target's pose."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    t_ns: Nanoseconds
    """When the tracker's shutter was open; the message that carries it may come much later."""
    pose: Pose
    """`target` in `world`, as for `TargetPose`."""
    sigma_m: Sigma
    """Of x and of y, by the tracker's own word."""
    sigma_rad: Sigma
    """Of the heading, likewise."""


class TargetObservation(Message):
    """What a tracker says at an instant: what it saw some time ago, or that it saw nothing."""

    sighting: Sighting | None


class TargetEstimate(Message):
    """What the planner believes of the target at an instant when nobody tells it the truth."""

    pose: Pose
    twist: Twist
    """World axes."""
    sigma_m: Sigma
    """Of x and of y."""
    sigma_rad: Sigma
    """Of the heading; pi is "unknown"."""
    num_used: Count
    """Measurements taken in since the start of the run."""
    num_refused: Count
    """Measurements that were too far off to be of this target."""
    num_missed: Count
    """Instants at which nothing was seen of it."""
