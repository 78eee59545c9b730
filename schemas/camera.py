"""What is said of a camera: its optics, where it is, where it shall go, how it moves."""

import math
from typing import Annotated, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field

from schemas.geometry import Coordinate, Pose, Twist
from schemas.message import ArrayLayout, ArrayMessage, Message, Name

MAX_CAMERAS = 64
MAX_SIDE_PX = 8192

CameraIndex = Annotated[int, Field(ge=0, lt=MAX_CAMERAS)]
Side = Annotated[int, Field(ge=1, le=MAX_SIDE_PX)]
Metres = Annotated[float, Field(gt=0, le=1e3)]


class Intrinsics(BaseModel):
    """A pinhole camera: u = fx X/Z + cx, v = fy Y/Z + cy; integers are pixel centres."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    width: Side
    height: Side
    fx: Annotated[float, Field(gt=0, le=1e6)]
    fy: Annotated[float, Field(gt=0, le=1e6)]
    cx: Annotated[float, Field(ge=-1e6, le=1e6)]
    cy: Annotated[float, Field(ge=-1e6, le=1e6)]

    @classmethod
    def from_vertical_fov(cls, width: int, height: int, vfov_rad: float) -> Self:
        """Square pixels, principal point in the image's middle."""
        focal_px = height / 2 / math.tan(vfov_rad / 2)
        return cls(
            width=width,
            height=height,
            fx=focal_px,
            fy=focal_px,
            cx=(width - 1) / 2,
            cy=(height - 1) / 2,
        )


class RobotGoal(BaseModel):
    """How the wheeled robot below a camera shall drive; it is where the camera is."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    heading_rad: Annotated[float, Field(ge=-10, le=10)]
    """phi_r, about the world's z from x; no angle on the circle."""
    v_mps: Coordinate
    """Along the heading; negative in reverse."""
    omega_rps: Coordinate
    v_dot: Coordinate
    """m/s^2."""
    camera_yaw_rad: Annotated[float, Field(ge=-10, le=10)]
    """psi: how the camera is fixed on the robot, from the heading to where it looks."""


class CameraGoal(Message):
    """The view a camera shall hold at the next instant, and how that view moves (world axes)."""

    camera: CameraIndex
    pose: Pose
    twist: Twist
    robot: RobotGoal | None = None
    """The same for a camera that is fixed on a robot with wheels; None: the camera flies."""


class CameraPose(Message):
    """Where camera `camera` is: `cam_<i>_optical` in `world`."""

    camera: CameraIndex
    pose: Pose
    twist: Twist


class CameraCommand(Message):
    """Velocity that the camera asks of its robot until the next tick (world axes)."""

    camera: CameraIndex
    twist: Twist
    camera_yaw_rad: Annotated[float, Field(ge=-10, le=10)] | None = None
    """How the camera is turned against the heading of its robot, if it asks for wheels."""


class CloudHeard(Message):
    """The mapper has camera `camera`'s cloud of this tick, and so all that it will have before."""

    camera: CameraIndex


class CameraInfo(Message):
    """What a camera is."""

    camera: CameraIndex
    intrinsics: Intrinsics
    depth_scale_m: Annotated[float, Field(ge=1e-6, le=1)]
    """Metres per unit of a depth image."""
    min_range_m: Annotated[float, Field(ge=0, le=1e3)]
    max_range_m: Metres
    baseline_m: Metres | None = None
    """Of a stereo pair."""
    noise: Name
    """The depth noise model, `unknown` for a real sensor."""


class ColorImage(ArrayMessage):
    """A JPEG picture of what the camera sees."""

    LAYOUT: ClassVar[ArrayLayout] = ArrayLayout("|u1", (None,), 32 << 20)

    camera: CameraIndex
    width: Side
    height: Side
