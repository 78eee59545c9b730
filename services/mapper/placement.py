"""Where the map's frame is in the world, and what its box is centred on."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Frame = Literal["world", "target"]
Follow = Literal["none", "target"]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """The frame the map is in, and whether its box follows the target through the world."""

    frame: Frame
    follow: Follow
    middle_m: tuple[float, float, float]
    """Middle of the box: in the map's frame, or, if it follows, from the target."""

    @property
    def needs_target(self) -> bool:
        """Whether an instant cannot begin before the target's pose is known."""
        return "target" in (self.frame, self.follow)

    def T_world_map(self, T_world_target: FloatArray) -> FloatArray:
        """Return the map's frame in the world, (4, 4)."""
        return T_world_target if self.frame == "target" else np.eye(4)

    def centre_m(self, T_world_target: FloatArray) -> FloatArray | None:
        """Return what the box is to be centred on, (3,) map frame; None: it stays."""
        if self.follow == "none":
            return None
        centre_m: FloatArray = T_world_target[:3, 3] + np.asarray(self.middle_m)
        return centre_m
