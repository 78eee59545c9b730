"""What stands around the map: views of cameras, their ring, the target's way."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from schemas.camera import Intrinsics
from services.kernels.rigid import FloatArray, apply
from services.recorder.export.theme import Theme

_EDGES = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
WEDGE_FACES = np.array([[0, 1, 2], [0, 2, 1]], np.int32)
"""Of the three corners of a wedge, seen from above and from below."""
_LEVEL_SINE = 0.05
_FLOOR_M = 0.004
"""What is drawn on the ground is drawn so far above it."""


class Lines(NamedTuple):
    """Lines of the world."""

    ends_m: FloatArray
    """(N, 2, 3)"""
    rgba: FloatArray
    """(N, 4)"""
    width_px: FloatArray
    """(N,)"""


def view_corners(T_world_camera: FloatArray, intrinsics: Intrinsics, depth_m: float) -> FloatArray:
    """Return (5, 3), world: the camera, and its image's corners at `depth_m`, clockwise."""
    k = intrinsics
    u = np.array([-0.5, k.width - 0.5, k.width - 0.5, -0.5])
    v = np.array([-0.5, -0.5, k.height - 0.5, k.height - 0.5])
    corners = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(4)], axis=1) * depth_m
    return apply(T_world_camera, np.concatenate([np.zeros((1, 3)), corners]))


def wedge_corners(
    T_world_camera: FloatArray, intrinsics: Intrinsics, reach_m: float, height_m: float
) -> FloatArray | None:
    """Return (3, 3) of what a camera sees of the level `height_m`, world, as if it looked along it.

    None for one that looks straight up or down.
    """
    ahead, right = T_world_camera[:2, 2], T_world_camera[:2, 0]
    level = float(np.hypot(*ahead))
    if level < _LEVEL_SINE:
        return None
    k = intrinsics
    sides = np.array([-0.5 - k.cx, k.width - 0.5 - k.cx]) / k.fx
    foot = T_world_camera[:2, 3]
    far = foot + reach_m * (ahead / level + sides[:, None] * right)
    corners = np.full((3, 3), height_m)
    corners[0, :2], corners[1:, :2] = foot, far
    return corners


def view_lines(corners_m: FloatArray, theme: Theme, width_px: float) -> Lines:
    """Return the edges of a view's (5, 3) corners."""
    ends = corners_m[np.array(_EDGES)]
    return _lines(ends, theme.camera, np.full(len(ends), 1.0), width_px)


def polygon_lines(polygon_m: Sequence[Sequence[float]], theme: Theme, width_px: float) -> Lines:
    """Return a formation's polygon (N, 3), closed, and a plumb line below each corner."""
    corners = np.asarray(polygon_m, np.float64).reshape(-1, 3)
    feet = corners * (1.0, 1.0, 0.0) + (0.0, 0.0, _FLOOR_M)
    sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    plumb = np.stack([corners, feet], axis=1)
    below = np.stack([feet, np.roll(feet, -1, axis=0)], axis=1)
    parts = [
        _lines(sides, theme.polygon, np.full(len(sides), 0.85), width_px),
        _lines(plumb, theme.polygon, np.full(len(plumb), 0.3), 0.6 * width_px),
        _lines(below, theme.polygon, np.full(len(below), 0.3), 0.8 * width_px),
    ]
    return joined(parts)


def trail_lines(places_m: FloatArray, shares: FloatArray, theme: Theme, width_px: float) -> Lines:
    """Return the way through (N, 3) places; `shares` (N,) of its colour are left of each."""
    on_floor = places_m * (1.0, 1.0, 0.0) + (0.0, 0.0, _FLOOR_M)
    ends = np.stack([on_floor[:-1], on_floor[1:]], axis=1)
    return _lines(ends, theme.target, 0.9 * shares[1:], width_px)


def heading_lines(
    T_world_target: FloatArray, length_m: float, theme: Theme, width_px: float
) -> Lines:
    """Return an arrow on the ground from the target's origin along its x axis."""
    tip, back, side = length_m, 0.82 * length_m, 0.08 * length_m
    points = np.array([[0, 0, 0], [tip, 0, 0], [back, side, 0], [back, -side, 0]], np.float64)
    points = apply(T_world_target, points + np.array([0.0, 0.0, _FLOOR_M]))
    ends = points[np.array([[0, 1], [1, 2], [1, 3]])]
    return _lines(ends, theme.target, np.full(3, 0.9), width_px)


def joined(parts: Sequence[Lines]) -> Lines:
    """Return all lines as one."""
    return Lines(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _lines(
    ends_m: FloatArray, rgb: NDArray[np.float64], alpha: FloatArray, width_px: float
) -> Lines:
    rgba = np.concatenate([np.tile(rgb, (len(ends_m), 1)), alpha[:, None]], axis=1)
    return Lines(ends_m, rgba, np.full(len(ends_m), width_px))
