"""The simulated world: its clock and its true state."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS, CameraIndex
from schemas.geometry import Pose, Twist
from schemas.message import Message, Name, Nanoseconds

SimMode = Literal["lockstep", "realtime"]
"""Every instant waits for all, or follows the clock."""
DeformationKind = Literal["breathing", "squash", "bend", "twist", "wave"]


class DeformationSpec(BaseModel):
    """One kinematic field: amplitude * sin(2 pi hz t + phase)."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    kind: DeformationKind
    amplitude: Annotated[float, Field(ge=0, le=2)]
    """Relative for breathing, squash and wave; radians from foot to top for bend and twist."""
    hz: Annotated[float, Field(ge=0, le=50)]
    phase_rad: Annotated[float, Field(ge=-10, le=10)] = 0.0


class SceneSpec(BaseModel):
    """All that is needed to rebuild the simulated object anywhere."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    object: Annotated[str, Field(min_length=1, max_length=1024)]
    """Name of a built-in mesh, or a mesh file."""
    height_m: Annotated[float, Field(gt=0, le=100)]
    subdivide: Annotated[int, Field(ge=0, le=4)]
    """Rounds of smooth (Loop) subdivision."""
    deformations: Annotated[tuple[DeformationSpec, ...], Field(max_length=8)]
    seed: Annotated[int, Field(ge=0, lt=2**63)]


class CameraBody(BaseModel):
    """Where the world has a camera: optical frame in `world`, twist in world axes."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    camera: CameraIndex
    pose: Pose
    twist: Twist


class SimState(Message):
    """The world's true state at `tick`; perception must never read it."""

    dt_ns: Annotated[int, Field(gt=0)]
    mode: SimMode
    target: Pose
    twist: Twist
    """Of the target, world axes."""
    scene: SceneSpec
    cameras: Annotated[tuple[CameraBody, ...], Field(max_length=MAX_CAMERAS)]


class SimClock(Message):
    """The simulation's clock and what it is doing."""

    dt_ns: Annotated[int, Field(gt=0)]
    mode: SimMode
    state: Literal["waiting", "running", "paused", "finished"]
    waiting_for: Annotated[tuple[Name, ...], Field(max_length=128)] = ()
    """Who has not acknowledged, as `service/instance`."""
    dropped: Annotated[tuple[Name, ...], Field(max_length=128)] = ()
    """Who was given up on and has not come back."""
    overruns: Annotated[int, Field(ge=0)] = 0
    """Ticks that came later than the wall clock asked (realtime)."""
    t_wall_ns: Nanoseconds = 0
