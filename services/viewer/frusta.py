"""Cameras as pyramids, with a small picture of what they see."""

import math

import numpy as np
from numpy.typing import NDArray

from schemas.camera import Intrinsics
from schemas.cloud import INVALID, NO_RETURN, DepthCloud
from schemas.geometry import Pose
from services.viewer.colours import PLASMA, camera_colour
from services.viewer.primitives import Frustum, Image

_NOTHING = (24, 24, 32)
_TABLE = np.vstack([PLASMA, np.array([_NOTHING], np.uint8)])
_RANGE_PERCENT = (2, 98)
"""Of the depths in an image: a single far pixel must not take the colours from the rest."""


def frustum(camera: int, pose: Pose, intrinsics: Intrinsics, image: Image | None) -> Frustum:
    """Place a camera.

    Args:
        camera: Its index.
        pose: Its optical frame in `world`.
        intrinsics: Its optics; the drawn pyramid is symmetric.
        image: What it shows, (H, W, 3).
    """
    return Frustum(
        camera,
        pose.matrix(),
        field_of_view(intrinsics.height, intrinsics.fy),
        intrinsics.width / intrinsics.height,
        camera_colour(camera),
        image,
    )


def field_of_view(side_px: int, focal_px: float) -> float:
    """Return the angle that a side of the image spans, rad."""
    return 2 * math.atan(side_px / (2 * focal_px))


def depth_image(cloud: DepthCloud, max_width_px: int) -> Image:
    """Return the depths as colours, near ones bright; what knows nothing is dark.

    Args:
        cloud: What the camera perceived.
        max_width_px: The image is thinned by a whole number until it is no wider.
    """
    stride = max(1, math.ceil(cloud.intrinsics.width / max_width_px))
    depth: NDArray[np.uint16] = cloud.array[::stride, ::stride]
    near, far = _range(depth)
    share = (far - depth.astype(np.float32)) * np.float32((len(PLASMA) - 1) / max(far - near, 1.0))
    index = np.clip(share, 0, len(PLASMA) - 1).astype(np.intp)
    index[(depth == INVALID) | (depth == NO_RETURN)] = len(PLASMA)
    image: Image = _TABLE.take(index, axis=0)
    return image


def _range(depth: NDArray[np.uint16]) -> tuple[float, float]:
    """Return where most depths of an image lie, its units."""
    some = depth[:: max(1, depth.shape[0] // 60), :: max(1, depth.shape[1] // 80)]
    known = some[(some != INVALID) & (some != NO_RETURN)]
    if not len(known):
        return 0.0, 1.0
    near, far = np.percentile(known, _RANGE_PERCENT)
    return float(near), float(far)
