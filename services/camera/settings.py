"""How a camera service is told what to do."""

import math
from typing import Annotated, Literal

from pydantic import Field

from schemas.camera import CameraIndex, Intrinsics, Side
from services.camera.drive import DriveLimits
from services.camera.sources.depth_sensor import DepthSettings
from services.camera.sources.open import SourceSettings
from services.camera.sources.simulated import SimulatedSettings
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
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of the noise."""
    drive: DriveLimits = DriveLimits()
    """What the camera's robot can do."""

    def instance(self) -> str:
        """Cameras are told apart by their index."""
        return str(self.camera)

    def intrinsics(self) -> Intrinsics:
        """Return the optics."""
        return Intrinsics.from_vertical_fov(self.width, self.height, math.radians(self.vfov_deg))

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
