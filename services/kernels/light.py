"""Light a picture of coloured square faces on the ground plane, with soft shadows.

Colours are linear: proportional to light, not to what a screen is told.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_CROWDED = (1.0, 0.84, 0.70, 0.58)
"""What a corner of a face gets of the sky's light, with 0 to 3 voxels that shut it in."""


class Squares(NamedTuple):
    """What the faces are; two triangles each, so that triangle n is of face n // 2."""

    corners_m: NDArray[np.float32]
    """(F, 4, 3) counter-clockwise from outside, world."""
    normal: NDArray[np.float32]
    """(F, 3) of the surface that the face is a step of, either sign; zero where unknown."""
    rgb: NDArray[np.float32]
    """(F, 3)"""
    crowding: NDArray[np.uint8]
    """(F, 4) as from `cubes.faces`."""


class Lamp(NamedTuple):
    """A far lamp and what it sees."""

    T_lamp_world: FloatArray
    """(4, 4) optical frame."""
    intrinsics: FloatArray
    """(4,) fx, fy, cx, cy in pixels."""
    depth_m: NDArray[np.float32]
    """(S, S) along the optical axis, inf = nothing."""
    slack_m: float
    """What lies no farther than this behind what the lamp sees is lit."""
    soft_px: int
    """Half the width of a shadow's edge."""


class Floor(NamedTuple):
    """The ground z = 0 with a grid, which fades into the distance."""

    rgb: FloatArray
    """(3,)"""
    line_rgb: FloatArray
    """(3,)"""
    square_m: float
    line_m: float
    """Width of the grid's lines."""
    centre_m: FloatArray
    """(2,)"""
    fade_m: FloatArray
    """(2,) at the first distance from the centre it begins to fade, at the second it is gone."""


class Mood(NamedTuple):
    """Where light comes from, and how much."""

    sun: float
    sky: float
    bounce: float
    """The sky's share that comes from below."""
    smooth: float
    """0: faces are lit by their own normals, 1: by the surface's."""
    zenith_rgb: FloatArray
    """(3,) of the background at the top of the picture."""
    horizon_rgb: FloatArray
    """(3,) of the background at its foot, and of what fades."""


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def lit_share(lamp: Lamp, x: float, y: float, z: float) -> float:
    """Return which share of the lamp a point of the world sees, 0 to 1."""
    T, K = lamp.T_lamp_world, lamp.intrinsics
    far = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if not far > 0.0:
        return 1.0
    u = K[0] * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / far + K[2]
    v = K[1] * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / far + K[3]
    reach, (height, width) = lamp.soft_px, lamp.depth_m.shape
    if not (reach <= u < width - reach - 2 and reach <= v < height - reach - 2):
        return 1.0
    i, j = int(u), int(v)
    probes = 0
    for q in (-reach, 0, reach + 1):
        for p in (-reach, 0, reach + 1):
            probes += int(lamp.depth_m[j + q, i + p] + lamp.slack_m >= far)
    if probes in (0, 9):  # Not at a shadow's edge: most of the scene.
        return 1.0 if probes else 0.0
    du, dv = u - i, v - j
    seen = 0.0
    # The mean over a window that slides with the point: its border pixels count in part.
    for q in range(-reach, reach + 2):
        on_v = 1.0 - dv if q == -reach else (dv if q == reach + 1 else 1.0)
        for p in range(-reach, reach + 2):
            on_u = 1.0 - du if p == -reach else (du if p == reach + 1 else 1.0)
            if lamp.depth_m[j + q, i + p] + lamp.slack_m >= far:
                seen += on_u * on_v
    return seen / (2 * reach + 1) ** 2


@njit(cache=True, error_model="numpy", nogil=True)
def paint(
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    squares: Squares,
    lamp: Lamp,
    floor: Floor,
    mood: Mood,
    T_world_camera: FloatArray,
    intrinsics: FloatArray,
) -> None:
    """Fill `rgb` (H, W, 3) with the light that comes from the squares, the floor and beyond.

    Args:
        rgb: out.
        depth_m: (H, W) along the optical axis, inf = nothing; where the floor is seen it is
            filled in.
        triangle: (H, W) triangle seen, negative where none is.
        squares: what the triangles are.
        lamp: the sun.
        floor: the ground.
        mood: how all is lit.
        T_world_camera: (4, 4) pose of the optical frame.
        intrinsics: (4,) fx, fy, cx, cy in pixels.
    """
    height, width = depth_m.shape
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    R, eye = T_world_camera[:3, :3], T_world_camera[:3, 3]
    sun = -lamp.T_lamp_world[2, :3]  # The lamp looks along its z axis; this points towards it.
    ray = np.empty(3)
    # What a pixel calls is inlined and goes by index: counting references to arrays costs more.
    for v in range(height):
        upward = 1.0 - v / height
        for u in range(width):
            x, y = (u - cx) / fx, (v - cy) / fy
            for k in range(3):
                ray[k] = R[k, 0] * x + R[k, 1] * y + R[k, 2]
            if triangle[v, u] >= 0:
                _paint_square(rgb, v, u, triangle[v, u] // 2, float(depth_m[v, u]), ray, eye, sun,
                              squares, lamp, mood)  # fmt: skip
                continue
            for k in range(3):
                beyond = mood.horizon_rgb[k] + upward * (mood.zenith_rgb[k] - mood.horizon_rgb[k])
                rgb[v, u, k] = np.float32(beyond)
            if ray[2] < -1e-6 and eye[2] > 0.0:
                z = -eye[2] / ray[2]
                if _paint_floor(rgb, v, u, z, ray, eye, sun[2], z / fx, floor, lamp, mood):
                    depth_m[v, u] = z


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _paint_square(
    rgb: NDArray[np.float32],
    v: int,
    u: int,
    face: int,
    z: float,
    ray: FloatArray,
    eye: FloatArray,
    sun: FloatArray,
    squares: Squares,
    lamp: Lamp,
    mood: Mood,
) -> None:
    corners, smooth, crowd = squares.corners_m, squares.normal, squares.crowding
    s, t, edge2, towards = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        inside = eye[k] + z * ray[k] - corners[face, 0, k]
        s += inside * (corners[face, 1, k] - corners[face, 0, k])
        t += inside * (corners[face, 3, k] - corners[face, 0, k])
        edge2 += (corners[face, 1, k] - corners[face, 0, k]) ** 2
        towards -= smooth[face, k] * ray[k]
    s, t = min(max(s / edge2, 0.0), 1.0), min(max(t / edge2, 0.0), 1.0)
    sign = mood.smooth if towards >= 0.0 else -mood.smooth
    length2, level, lambert = 0.0, 0.0, 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        own = (
            (corners[face, 1, i] - corners[face, 0, i])
            * (corners[face, 3, j] - corners[face, 0, j])
            - (corners[face, 1, j] - corners[face, 0, j])
            * (corners[face, 3, i] - corners[face, 0, i])
        ) / edge2
        normal = (1.0 - mood.smooth) * own + sign * smooth[face, k]
        length2 += normal * normal
        lambert += normal * sun[k]
        level = normal  # The last one is z.
    length = np.sqrt(max(length2, 1e-12))
    lambert, level = max(lambert / length, 0.0), level / length
    if lambert > 0.0:
        lambert *= lit_share(lamp, eye[0] + z * ray[0], eye[1] + z * ray[1], eye[2] + z * ray[2])
    open_ = (1.0 - t) * (
        (1.0 - s) * _CROWDED[crowd[face, 0]] + s * _CROWDED[crowd[face, 1]]
    ) + t * (s * _CROWDED[crowd[face, 2]] + (1.0 - s) * _CROWDED[crowd[face, 3]])
    sky = mood.sky * open_ * (mood.bounce + (1.0 - mood.bounce) * 0.5 * (1.0 + level))
    for k in range(3):
        rgb[v, u, k] = np.float32(
            squares.rgb[face, k] * (sky + mood.sun * lambert * (0.5 + 0.5 * open_))
        )


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _paint_floor(
    rgb: NDArray[np.float32],
    v: int,
    u: int,
    z: float,
    ray: FloatArray,
    eye: FloatArray,
    lambert: float,
    pixel_m: float,
    floor: Floor,
    lamp: Lamp,
    mood: Mood,
) -> bool:
    """Blend the floor over the background; return whether any of it is seen."""
    x, y = eye[0] + z * ray[0], eye[1] + z * ray[1]
    away = np.hypot(x - floor.centre_m[0], y - floor.centre_m[1])
    near = (floor.fade_m[1] - away) / (floor.fade_m[1] - floor.fade_m[0])
    near = min(max(near, 0.0), 1.0)
    near = near * near * (3.0 - 2.0 * near)
    if near == 0.0:
        return False
    # A pixel sees a strip of the floor that is the longer, the flatter the view.
    blur = pixel_m / max(-ray[2] / np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2), 0.02)
    line = max(_on_line(x, floor, blur), _on_line(y, floor, blur))
    light = mood.sky + mood.sun * lambert * lit_share(lamp, x, y, 0.0)
    for k in range(3):
        colour = (floor.rgb[k] + line * (floor.line_rgb[k] - floor.rgb[k])) * light
        rgb[v, u, k] += np.float32(near) * (np.float32(colour) - rgb[v, u, k])
    return True


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _on_line(x: float, floor: Floor, blur_m: float) -> float:
    """Return which share of a strip of floor around `x` lies on a line of the grid."""
    off = abs(x - floor.square_m * np.round(x / floor.square_m))
    half, blur = 0.5 * floor.line_m, max(blur_m, 1e-9)
    share: float = (min(off + 0.5 * blur, half) - max(off - 0.5 * blur, -half)) / blur
    return min(max(share, 0.0), 1.0)
