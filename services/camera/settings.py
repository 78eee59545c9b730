"""How a camera service is told what to do."""

import math
from typing import Annotated, Literal, assert_never

from pydantic import Field

from schemas.camera import CameraIndex, Intrinsics, Side
from services.camera.drive import DriveLimits
from services.camera.flying import FlyingPilot
from services.camera.pilot import Pilot
from services.camera.planned import PlannedPilot
from services.camera.sources.depth_sensor import DepthSettings
from services.camera.sources.open import SourceSettings
from services.camera.sources.simulated import SimulatedSettings
from services.camera.unicycle import UnicyclePilot, UnicycleSettings
from services.runtime.settings import ServiceSettings


class CameraSettings(ServiceSettings, DepthSettings):
    """One depth camera that looks, and flies to where it shall look from."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_CAMERA_"}

    camera: CameraIndex = 0
    """Index of this camera, from 0."""
    source: Literal["simulated"] = "simulated"
    """Where its images come from."""
    width: Side = 640
    """Of the images, px."""
    height: Side = 480
    """Of the images, px."""
    vfov_deg: Annotated[float, Field(gt=1, lt=170)] = 45.0
    """Vertical field of view, degrees."""
    color: bool = False
    """Also publish colour pictures while somebody reads them."""
    clouds_under_way: Annotated[int, Field(ge=0, le=64)] = 2
    """While time is real: clouds that may be on their way to the mapper at once. What a link does
    not carry waits, and is replaced by what is newer; 0 sends all, and lets links queue them."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of the noise."""
    drive: Literal["flying", "unicycle", "planned"] = "flying"
    """flying: six degrees of freedom; unicycle: fixed on a robot with wheels; planned: as the goal
    at hand says, in a world where both can be had."""
    flying: DriveLimits = DriveLimits()
    """What a flying camera can do."""
    unicycle: UnicycleSettings = UnicycleSettings()
    """What a robot with wheels can do, and how it is steered."""

    def instance(self) -> str:
        """Cameras are told apart by their index."""
        return str(self.camera)

    def intrinsics(self) -> Intrinsics:
        """Return the optics."""
        return Intrinsics.from_vertical_fov(self.width, self.height, math.radians(self.vfov_deg))

    def pilot(self) -> Pilot:
        """Open the pilot of the chosen drive."""
        match self.drive:
            case "flying":
                return FlyingPilot(self.flying)
            case "unicycle":
                return UnicyclePilot(self.unicycle)
            case "planned":
                return PlannedPilot(FlyingPilot(self.flying), UnicyclePilot(self.unicycle))
            case _:
                assert_never(self.drive)

    def source_settings(self) -> SourceSettings:
        """Return the settings of the source alone."""
        depth = {name: getattr(self, name) for name in DepthSettings.model_fields}
        return SimulatedSettings(
            camera=self.camera,
            seed=self.seed,
            intrinsics=self.intrinsics(),
            color=self.color,
            **depth,
        )
