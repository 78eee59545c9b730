"""Lateral noise: near a jump in depth, pixels look astray and report the other surface."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.kernels.depth_noise import (
    Draws,
    NoiseModel,
    grazing_term,
    incidence_cosine,
    reported,
)

_REACH = 3  # pixels; about three standard deviations of the widest lateral noise.
# A jump of 1 % (11 mm at 1.1 m): what is smaller drowns in the noise along the ray.
_JUMP = np.float32(0.01)
_EDGE, _DONE = np.uint8(1), np.uint8(2)
_ONE, _TWO = np.float32(1.0), np.float32(2.0)


@njit(cache=True, error_model="numpy", nogil=True)
def mark_edges(depth_m: NDArray[np.float32], marks: NDArray[np.uint8]) -> None:
    """Fill `marks` (H, W) with 1 on both sides of each jump in depth, else 0.

    The second difference of 1/z vanishes on every plane, however slanted, but not at a jump.
    The image's outermost pixels are compared inwards only along their border.
    """
    height, width = depth_m.shape
    rows = np.empty((3, width), np.float32)
    for v in range(height + 1):
        if v < height:
            for u in range(width):
                rows[v % 3, u] = _ONE / depth_m[v, u]
        if v == 0:
            continue
        here, up, down = rows[(v - 1) % 3], rows[(v - 2) % 3], rows[v % 3]
        out = marks[v - 1]
        out[0] = out[width - 1] = 0
        for u in range(1, width - 1):
            bend = abs(here[u - 1] - _TWO * here[u] + here[u + 1])
            out[u] = _EDGE if bend > _JUMP * here[u] else 0
        if 1 < v < height:
            for u in range(width):
                bend = abs(up[u] - _TWO * here[u] + down[u])
                out[u] |= _EDGE if bend > _JUMP * here[u] else 0


@njit(cache=True, error_model="numpy", nogil=True)
def jitter_edges(
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    face_cosines: NDArray[np.float32],
    camera_height_m: float,
    intrinsics: NDArray[np.float64],
    ranges: tuple[float, float, float],
    model: NoiseModel,
    draws: Draws,
    marks: NDArray[np.uint8],
    raw: NDArray[np.uint16],
) -> None:
    """Let the pixels near jumps look astray by the model's lateral noise.

    A pixel whose astray look meets a surface across the jump reports that one, with its noise.

    Args:
        depth_m, triangle, face_cosines, camera_height_m, intrinsics, ranges, model, draws: As of
            `add_noise`.
        marks: (H, W) from `mark_edges`; used up.
        raw: (H, W) of `add_noise`, updated in place.
    """
    height, width = depth_m.shape
    draw = draws.normal_starts[0]
    for v in range(height):
        for u in range(width):
            if not marks[v, u] & _EDGE:
                continue
            # What lies around an edge pixel to the left or above is done already.
            first_x = u + _REACH if u > 0 and marks[v, u - 1] & _EDGE else max(u - _REACH, 0)
            first_y = v + _REACH if v > 0 and marks[v - 1, u] & _EDGE else max(v - _REACH, 0)
            for y in range(first_y, min(v + _REACH + 1, height)):
                for x in range(first_x, min(u + _REACH + 1, width)):
                    if marks[y, x] & _DONE:
                        continue
                    marks[y, x] |= _DONE
                    draw = (draw + 3) % (draws.normals.size - 2)
                    own = incidence_cosine(
                        depth_m[y, x], triangle[y, x], face_cosines, camera_height_m,
                        intrinsics, x, y,
                    )  # fmt: skip
                    sigma_px = model.lateral_px + model.lateral_grazing_px * grazing_term(own)
                    look_u = x + int(np.rint(sigma_px * draws.normals[draw]))
                    look_v = y + int(np.rint(sigma_px * draws.normals[draw + 1]))
                    look_u = min(max(look_u, 0), width - 1)
                    look_v = min(max(look_v, 0), height - 1)
                    z, seen = depth_m[y, x], depth_m[look_v, look_u]
                    if abs(_ONE / seen - _ONE / z) <= _JUMP / min(seen, z):
                        continue
                    cosine = incidence_cosine(
                        seen, triangle[look_v, look_u], face_cosines, camera_height_m,
                        intrinsics, look_u, look_v,
                    )  # fmt: skip
                    uniform = draws.uniforms[draw % draws.uniforms.size]
                    raw[y, x] = reported(
                        seen, cosine, draws.normals[draw + 2], uniform, ranges, model
                    )
