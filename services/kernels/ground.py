"""Draw the ground: the plane z = 0 of the world, without triangles."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, error_model="numpy", nogil=True)
def fill_ground(
    T_world_camera: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    near_m: float,
    max_range_m: float,
    depth_m: NDArray[np.float32],
) -> None:
    """Overwrite `depth_m` (H, W) with the ground's depth, inf where it is not in range.

    A ray meets the plane at depth -height / slope, and the slope is linear in the pixel.

    Args:
        T_world_camera: (4, 4) pose of the optical frame.
        intrinsics: (4,) fx, fy, cx, cy in pixels.
        near_m: nearest depth drawn.
        max_range_m: farthest depth drawn.
        depth_m: (H, W) depth along the optical axis; wholly overwritten.
    """
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    R = T_world_camera[2, :3]
    drop_m = -T_world_camera[2, 3]
    step = R[0] / fx
    for v in range(depth_m.shape[0]):
        slope = R[2] + R[1] * (v - cy) / fy - step * cx
        for u in range(depth_m.shape[1]):
            z = drop_m / (slope + step * u)
            depth_m[v, u] = z if (z >= near_m) & (z <= max_range_m) else np.inf
