"""What the planner is told about cameras, robots and the size of the target."""

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from services.planner.rules import Drive, Limits

Metres = Annotated[float, Field(ge=0, le=1e4)]
Greatest = Annotated[float, Field(gt=0, le=1e4)] | None


class LimitSettings(BaseModel):
    """Flat, as the formation's: environment and flags name each by one word."""

    model_config = ConfigDict(frozen=True)

    beta_deg: Annotated[float, Field(gt=0, lt=90)] = 28.9
    """Half of the cameras' horizontal field of view; 640x480 with 45 degrees upright."""
    beta_up_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    """Half of their vertical field of view; images are high enough if not given."""
    target_radius_m: Metres = 0.0
    """So much about the target's centre must be seen."""
    v_max_mps: Greatest = None
    """Greatest speed of a camera's robot; no limit if not given."""
    omega_max_rps: Greatest = None
    """Greatest turn rate of a camera's robot; no limit if not given."""
    robot_distance_m: Metres = 0.0
    """Least distance between two cameras."""
    robot_radius_m: Metres = 0.0
    """From a camera to the outermost point of its robot."""
    range_min_m: Metres = 0.0
    """Nearer than this a camera sees nothing."""
    range_max_m: Greatest = None
    """Farther than this a camera sees nothing; no limit if not given."""

    def limits(self, drive: Drive) -> Limits:
        """Return what a formation is held against."""
        return Limits(
            beta_rad=math.radians(self.beta_deg),
            drive=drive,
            target_radius_m=self.target_radius_m,
            v_max_mps=self.v_max_mps,
            omega_max_rps=self.omega_max_rps,
            robot_radius_m=self.robot_radius_m,
            robot_distance_m=self.robot_distance_m,
            range_min_m=self.range_min_m,
            range_max_m=self.range_max_m,
            beta_up_rad=None if self.beta_up_deg is None else math.radians(self.beta_up_deg),
        )
