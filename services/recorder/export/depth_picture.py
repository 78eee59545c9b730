"""Depth images as pictures."""

import numpy as np
from numpy.typing import NDArray

from schemas.cloud import INVALID, NO_RETURN, DepthCloud
from services.kernels.palette import MAGMA, colours

_NOTHING = 0.16
"""Grey of what did not return, sRGB."""


def depth_picture(
    cloud: DepthCloud, near_m: float, far_m: float, max_width: int
) -> NDArray[np.float64]:
    """Return the depth image as (h, w, 3) sRGB, 0 to 1: near is bright, far is dark.

    It is made smaller by a whole number, by taking every so many-th pixel's neighbourhood's mean.

    Args:
        cloud: the image.
        near_m: what has the brightest colour. far_m: what has the darkest.
        max_width: the picture is no wider, pixels.
    """
    step = max(1, -(-cloud.array.shape[1] // max_width))
    height, width = (side // step * step for side in cloud.array.shape)
    depth = cloud.array[:height, :width]
    known = (depth != INVALID) & (depth != NO_RETURN)
    blocks = (height // step, step, width // step, step)
    count = known.reshape(blocks).sum(axis=(1, 3))
    total = np.where(known, depth, 0).astype(np.int64).reshape(blocks).sum(axis=(1, 3))
    mean_m = total / np.maximum(count, 1) * cloud.depth_scale_m
    share = (far_m - mean_m) / max(far_m - near_m, 1e-9)
    rgb = colours(MAGMA, 0.12 + 0.83 * np.clip(share, 0.0, 1.0))
    rgb[count == 0] = _NOTHING
    return rgb


def depth_reach(cloud: DepthCloud) -> tuple[float, float] | None:
    """Return between which depths most of an image's returns lie, m; None if it has none."""
    depth = cloud.array[::4, ::4]
    known = depth[(depth != INVALID) & (depth != NO_RETURN)]
    if not len(known):
        return None
    low, high = np.percentile(known, (1, 90)) * cloud.depth_scale_m
    return float(low), float(high)
