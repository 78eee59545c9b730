"""What a camera perceives: an organised cloud (a depth image) or an unorganised one."""

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from schemas.camera import CameraIndex, Intrinsics, Metres
from schemas.geometry import Pose
from schemas.message import ArrayLayout, ArrayMessage, Nanoseconds

INVALID = 0
"""A depth pixel that knows nothing."""
NO_RETURN = 65535
"""A depth pixel that looked and saw nothing within the sensor's range: the ray is free."""
MAX_CLOUD_BYTES = 128 << 20


class _CloudBase(ArrayMessage):
    camera: CameraIndex
    pose: Pose
    """`cam_<i>_optical` in `frame_id` at capture."""
    max_range_m: Metres
    t_capture_ns: Nanoseconds
    """Wall clock at the shutter; latency is counted from here."""


class DepthCloud(_CloudBase):
    """An organised cloud: depth along the optical axis, (H, W) uint16, times `depth_scale_m`."""

    LAYOUT: ClassVar[ArrayLayout] = ArrayLayout("<u2", (None, None), MAX_CLOUD_BYTES)

    kind: Literal["depth"] = "depth"
    intrinsics: Intrinsics
    depth_scale_m: Annotated[float, Field(ge=1e-6, le=1)]

    @model_validator(mode="after")
    def _image_has_the_intrinsics_size(self) -> "DepthCloud":
        size = (self.intrinsics.height, self.intrinsics.width)
        if self.shape != size:
            raise ValueError(f"shape {self.shape} must be (height, width) = {size}")
        return self

    def points_world(self) -> NDArray[np.float64]:
        """Return the (N, 3) returns in `frame_id`, metres; N is the number of returns."""
        depth = self.array
        v, u = np.nonzero((depth != INVALID) & (depth != NO_RETURN))
        z = depth[v, u] * self.depth_scale_m
        k = self.intrinsics
        camera = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=1)
        return _to_world(camera, self.pose)


class XyzCloud(_CloudBase):
    """An unorganised cloud: (N, 3) float32 points in the optical frame; NaN is invalid."""

    LAYOUT: ClassVar[ArrayLayout] = ArrayLayout("<f4", (None, 3), MAX_CLOUD_BYTES)

    kind: Literal["xyz"] = "xyz"

    def points_world(self) -> NDArray[np.float64]:
        """Return the (N, 3) finite points in `frame_id`, metres."""
        points = self.array
        return _to_world(points[np.isfinite(points).all(axis=1)].astype(np.float64), self.pose)


Cloud = DepthCloud | XyzCloud
CLOUD: Any = Annotated[Cloud, Field(discriminator="kind")]
"""The union as pydantic validates it."""


def _to_world(points: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    T = pose.matrix()
    world: NDArray[np.float64] = points @ T[:3, :3].T + T[:3, 3]
    return world
