"""A depth image: what it holds, where it was taken, how it is read."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.mapper.box import Box

INVALID = 0
"""A pixel that knows nothing."""
NO_RETURN = 65535
"""A pixel that looked and saw nothing: free up to the maximum range."""
_SNAP = 1e-6
Vector = NDArray[np.float32]


@dataclass(frozen=True)
class View:
    """One depth image: (H, W) uint16, where it was taken (map frame) and how to read it."""

    depth: NDArray[np.uint16]
    pinhole: tuple[float, float, float, float]
    T_map_camera: NDArray[np.float64]
    scale_m: float
    max_range_m: float

    @property
    def limit(self) -> np.uint16:
        """The last raw depth that counts as a return."""
        units = self.max_range_m / self.scale_m + _SNAP  # 0.3 m in units of 0.1 m is 3.
        return np.uint16(min(int(units), NO_RETURN - 1))

    def pixels_in(self, box: Box) -> tuple[Vector, Vector, Vector, Vector]:
        """Return du, dv, corner, offset: where pixel (u, v) of raw depth d ends, in voxels.

        That is d * (u * du + v * dv + corner) + offset; each (3,).
        """
        fx, fy, cx, cy = self.pinhole
        R, per_raw = self.T_map_camera[:3, :3], self.scale_m / box.resolution_m
        du, dv = R[:, 0] * per_raw / fx, R[:, 1] * per_raw / fy
        corner = R[:, 2] * per_raw - du * cx - dv * cy
        offset = (self.T_map_camera[:3, 3] - box.origin_m) / box.resolution_m
        return (
            du.astype(np.float32),
            dv.astype(np.float32),
            corner.astype(np.float32),
            offset.astype(np.float32),
        )
