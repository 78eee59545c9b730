"""The map's error, painted on the true surface: what is in the map, what is not, and why."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.camera import Intrinsics
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import FloatArray
from services.viewer.colours import Rgb
from services.viewer.primitives import Faces, Points32

MAPPED, MISSED, OCCLUDED = 0, 1, 2
CLASSES: dict[str, Rgb] = {
    "mapped": (46, 160, 110),
    "missed": (240, 165, 40),
    "occluded": (95, 100, 120),
}
"""A triangle near an occupied voxel; one that a camera sees and the map has not got; one that no
camera sees."""
GHOST: Rgb = (230, 40, 160)
"""An occupied voxel that is nowhere near the surface."""
TOLERANCE_VOXELS = 2.0
"""The evaluator's headline: what is closer counts as mapped."""

_SIDE_PX = 320  # Of the images in which it is found who sees what: a pixel is 3 mm at 1 m.
_NEAR_M = 0.01
_BEHIND_SHARE, _BEHIND_M = 0.01, 0.01  # Deeper than the image by more than this: hidden.
_GRAZING = 0.087  # cos 85 degrees, the evaluator's limit.


@dataclass(frozen=True)
class View:
    """A camera, from the surface."""

    T_surface_camera: FloatArray
    intrinsics: Intrinsics


def paint(
    vertices_m: Points32,
    faces: Faces,
    centres_m: FloatArray,
    resolution_m: float,
    views: Sequence[View],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Compare a map with a surface.

    Args:
        vertices_m: (V, 3) of the surface, its own frame.
        faces: (F, 3) counter-clockwise seen from outside.
        centres_m: (M, 3) of the occupied voxels above the ground, the surface's frame.
        resolution_m: Edge of a voxel.
        views: The cameras at that instant.

    Returns:
        (F,) class of each triangle, and (M,) whether each voxel is a ghost. A voxel counts as one
        only beyond the tolerance and half the longest edge, as distances are to corners and
        middles of triangles.
    """
    from scipy.spatial import cKDTree  # Slow to import, and only needed when this is looked at.

    corners = vertices_m[faces]
    middles = corners.mean(axis=1)
    tolerance = TOLERANCE_VOXELS * resolution_m
    classes = np.where(_seen(vertices_m, faces, middles, views), MISSED, OCCLUDED)
    if not len(centres_m):
        return classes, np.zeros(0, np.bool_)
    near, _ = cKDTree(centres_m).query(middles, distance_upper_bound=tolerance)
    classes[np.isfinite(near)] = MAPPED
    longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
    surface = cKDTree(np.concatenate([vertices_m, middles]))
    far, _ = surface.query(centres_m, distance_upper_bound=tolerance + longest / 2)
    return classes, ~np.isfinite(far)


def _seen(
    vertices_m: Points32, faces: Faces, middles_m: Points32, views: Sequence[View]
) -> NDArray[np.bool_]:
    """(F,) whether a camera sees the middle of each triangle, by a depth image of its own."""
    seen = np.zeros(len(faces), np.bool_)
    a, b, c = (vertices_m[faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    for view in views:
        T, k = view.T_surface_camera, view.intrinsics
        shrink = min(1.0, _SIDE_PX / max(k.width, k.height))
        shape = max(1, round(k.height * shrink)), max(1, round(k.width * shrink))
        pinhole = np.array([k.fx, k.fy, k.cx, k.cy]) * shrink
        depth = np.full(shape, np.inf, np.float32)
        points = np.empty(vertices_m.shape)
        to_camera(vertices_m, T, points)
        rasterise(points, faces, pinhole, _NEAR_M, depth, np.empty(shape, np.int32))
        x, y, z = T[:3, :3].T @ (middles_m - T[:3, 3]).T
        ahead = np.where(z > _NEAR_M, z, np.inf)
        u = np.rint(pinhole[0] * x / ahead + pinhole[2])
        v = np.rint(pinhole[1] * y / ahead + pinhole[3])
        inside = (z > _NEAR_M) & (u >= 0) & (u < shape[1]) & (v >= 0) & (v < shape[0])
        to_eye = T[:3, 3] - middles_m
        facing = np.einsum("fd,fd->f", normals, to_eye)
        inside &= facing > _GRAZING * np.linalg.norm(to_eye, axis=1)
        at = np.flatnonzero(inside)
        drawn = depth[v[at].astype(np.intp), u[at].astype(np.intp)]
        seen[at] |= z[at] <= drawn * (1 + _BEHIND_SHARE) + _BEHIND_M
    return seen
