"""Draw straight lines with soft edges into a picture that has depths."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(cache=True, error_model="numpy", nogil=True)
def draw_lines(
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    ends_camera_m: FloatArray,
    rgba: FloatArray,
    width_px: FloatArray,
    intrinsics: FloatArray,
    near_m: float,
    slack_m: float,
    hidden: float,
) -> None:
    """Blend lines into `rgb` in the order in which they are given.

    Args:
        rgb: (H, W, 3) changed in place.
        depth_m: (H, W) along the optical axis, inf = nothing; not changed.
        ends_camera_m: (N, 2, 3) in the optical frame.
        rgba: (N, 4) colour and opacity, 0 to 1.
        width_px: (N,).
        intrinsics: (4,) fx, fy, cx, cy in pixels.
        near_m: what is nearer is cut off.
        slack_m: a line is seen if it lies no farther than this behind what is seen there.
        hidden: the share of its opacity that a line behind something keeps.
    """
    height, width = depth_m.shape
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    end = np.empty((2, 3))
    for n in range(ends_camera_m.shape[0]):
        end[:] = ends_camera_m[n]
        if not (end[0, 2] > near_m or end[1, 2] > near_m):
            continue
        for e in range(2):
            if end[e, 2] < near_m:
                s = (near_m - end[1 - e, 2]) / (end[e, 2] - end[1 - e, 2])
                end[e] = end[1 - e] + s * (end[e] - end[1 - e])
                end[e, 2] = near_m
        u0, v0 = fx * end[0, 0] / end[0, 2] + cx, fy * end[0, 1] / end[0, 2] + cy
        u1, v1 = fx * end[1, 0] / end[1, 2] + cx, fy * end[1, 1] / end[1, 2] + cy
        i0, i1 = 1.0 / end[0, 2], 1.0 / end[1, 2]
        du, dv = u1 - u0, v1 - v0
        length2 = max(du * du + dv * dv, 1e-12)
        margin = 0.5 * width_px[n] + 0.5
        first_v = max(int(np.ceil(max(min(v0, v1) - margin, 0.0))), 0)
        last_v = min(int(np.floor(min(max(v0, v1) + margin, height - 1.0))), height - 1)
        for v in range(first_v, last_v + 1):
            # Only the part of the row that the line comes near to: lines may be long.
            low, high = min(u0, u1) - margin, max(u0, u1) + margin
            if abs(dv) > 1e-9:
                a = (v - margin - v0) / dv
                b = (v + margin - v0) / dv
                a, b = max(min(a, b), 0.0), min(max(a, b), 1.0)
                low = max(low, min(u0 + a * du, u0 + b * du) - margin)
                high = min(high, max(u0 + a * du, u0 + b * du) + margin)
            if not (low < width and high >= 0.0):
                continue
            for u in range(max(int(np.ceil(low)), 0), min(int(np.floor(high)), width - 1) + 1):
                t = min(max(((u - u0) * du + (v - v0) * dv) / length2, 0.0), 1.0)
                away = np.hypot(u - u0 - t * du, v - v0 - t * dv)
                cover = min(max(margin - away, 0.0), 1.0)
                if cover == 0.0:
                    continue
                z = 1.0 / (i0 + t * (i1 - i0))
                alpha = rgba[n, 3] * cover
                if z > depth_m[v, u] + slack_m:
                    alpha *= hidden
                for k in range(3):
                    rgb[v, u, k] += np.float32(alpha) * (np.float32(rgba[n, k]) - rgb[v, u, k])
