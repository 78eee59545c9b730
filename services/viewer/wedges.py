"""What cameras have in view, seen from above: a sector of the ground each."""

from collections.abc import Mapping

import numpy as np

from services.kernels.rigid import FloatArray, apply, inverse
from services.viewer.colours import camera_colour
from services.viewer.primitives import Faces, Lines, Surface

_ARC = 12
"""Triangles of a sector; at 60 degrees its edge is a millimetre off per metre."""
_STEEPEST = 0.05  # Sine; a camera that looks straight down has no direction on the ground.
_FINEST = 3  # Digits of a metre: what differs by less need not be told to a browser again.

View = tuple[FloatArray, float]
"""T_world_camera (4, 4), optical frame, and the horizontal field of view, rad."""


def sectors(
    views: Mapping[int, View], reach_m: float, above_m: float, T_world_sectors: FloatArray
) -> dict[int, FloatArray]:
    """Return by camera the corners of its sector, its eye first and then along the rim.

    Args:
        views: By camera.
        reach_m: How far the sectors reach.
        above_m: How high above the ground they lie.
        T_world_sectors: The frame in which they are wanted.

    Returns:
        (14, 3) each.
    """
    found = {}
    T_sectors_world = inverse(T_world_sectors)
    for camera, (T, hfov_rad) in views.items():
        axis = T[:2, 2]
        if np.linalg.norm(axis) < _STEEPEST:
            continue
        heading = np.arctan2(axis[1], axis[0])
        angles = heading + hfov_rad * np.linspace(-0.5, 0.5, _ARC + 1)
        rim = T[:2, 3] + reach_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        flat = np.concatenate([T[None, :2, 3], rim])
        corners = np.column_stack([flat, np.full(len(flat), above_m)])
        found[camera] = apply(T_sectors_world, corners).round(_FINEST)
    return found


def wedges(found: Mapping[int, FloatArray], T_world_sectors: FloatArray) -> Surface | None:
    """Return all sectors as one surface; None if there is none."""
    if not found:
        return None
    fan = np.arange(_ARC, dtype=np.int32)
    one = np.stack([np.zeros_like(fan), 1 + fan, 2 + fan], axis=1)
    faces: Faces = np.concatenate([one + number * (_ARC + 2) for number in range(len(found))])
    vertices = np.concatenate(list(found.values()))
    return Surface(vertices.astype(np.float32), faces.astype(np.int32), T_world_sectors)


def rims(found: Mapping[int, FloatArray], T_world_sectors: FloatArray) -> Lines | None:
    """Return what bounds the sectors, each in its camera's colour; None if there is none."""
    if not found:
        return None
    segments = [np.stack([line, np.roll(line, -1, axis=0)], axis=1) for line in found.values()]
    colours = [
        np.broadcast_to(np.array(camera_colour(camera), np.uint8), segments[0].shape)
        for camera in found
    ]
    return Lines(
        np.concatenate(segments).astype(np.float32), np.concatenate(colours), T_world_sectors
    )
