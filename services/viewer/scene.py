"""From the newest messages to a frame."""

from collections.abc import Mapping

import numpy as np

from schemas.cloud import Cloud
from schemas.geometry import WORLD
from services.kernels.rigid import FloatArray, apply, inverse
from services.viewer.colours import camera_colour
from services.viewer.frusta import field_of_view, frustum
from services.viewer.newest import Newest
from services.viewer.options import Options
from services.viewer.primitives import Frame, Frustum, Image, Lines, Points
from services.viewer.trail import Trail
from services.viewer.voxels import Voxels
from services.viewer.wedges import View, rims, sectors, wedges

_FORMATION_COLOUR = (60, 120, 220)
_CLOUD_POINT_M = 0.004
_WEDGE_BEYOND = 1.15
"""Of the way to the centre, so that sectors meet behind the target."""
_WEDGE_M = 1.0  # Without a formation nobody says where they look.
_ABOVE_GROUND_M = 0.004
_ABOVE_VOXELS = 2.0
"""Voxels; the mapped ground, a voxel thick, would hide what lies on it."""
_FINEST = 3  # Digits of a metre: what differs by less need not be told to a browser again.


def frame(
    newest: Newest,
    voxels: Voxels,
    trail: Trail,
    options: Options,
    images: Mapping[int, Image] | None = None,
) -> Frame:
    """Return what is to be drawn; what compares with the truth is added by who knows it.

    Args:
        newest: Messages.
        voxels: Of the map.
        trail: Of the target.
        options: What is wanted.
        images: By camera, for the pyramids.
    """
    T_world_target = np.eye(4) if newest.target is None else newest.target.pose.matrix()
    above_m = _ABOVE_GROUND_M
    if options.voxels and voxels.held is not None:
        above_m += _ABOVE_VOXELS * voxels.held.resolution_m
    seen = _sectors(newest, above_m, T_world_target) if options.wedges else {}
    return Frame(
        voxels=voxels.points(options.colour_by, options.max_points) if options.voxels else None,
        frusta=_frusta(newest, images or {}) if options.cameras else (),
        wedges=wedges(seen, T_world_target),
        rims=rims(seen, T_world_target),
        formation=_formation(newest, T_world_target) if options.formation else None,
        path=trail.path(above_m) if options.trail else None,
        trail=trail.recent(above_m, T_world_target) if options.trail else None,
        target=None if newest.target is None else T_world_target,
        middle_m=_middle(newest) if options.follow else (0.0, 0.0),
        cloud=merged_cloud(newest.clouds, options.max_points) if options.cloud else None,
        dark=options.dark,
    )


def _middle(newest: Newest) -> tuple[float, float]:
    if newest.target is None:
        return 0.0, 0.0
    x, y, _ = newest.target.pose.position
    return x, y


def _frusta(newest: Newest, images: Mapping[int, Image]) -> tuple[Frustum, ...]:
    return tuple(
        frustum(camera, told.pose, newest.infos[camera].intrinsics, images.get(camera))
        for camera, told in sorted(newest.poses.items())
        if camera in newest.infos
    )


def _sectors(newest: Newest, above_m: float, T: FloatArray) -> dict[int, FloatArray]:
    views: dict[int, View] = {}
    for camera, told in sorted(newest.poses.items()):
        if camera in newest.infos:
            k = newest.infos[camera].intrinsics
            views[camera] = told.pose.matrix(), field_of_view(k.width, k.fx)
    reach_m = _WEDGE_M
    if newest.formation is not None and views:
        centre = newest.formation.centre[:2]
        away = [np.linalg.norm(eye[:2, 3] - centre) for eye, _ in views.values()]
        reach_m = _WEDGE_BEYOND * float(np.median(away))
    return sectors(views, reach_m, above_m, T)


def _formation(newest: Newest, T_world_lines: FloatArray) -> Lines | None:
    if newest.formation is None or len(newest.formation.polygon) < 2:
        return None
    corners = apply(inverse(T_world_lines), np.asarray(newest.formation.polygon, np.float64))
    corners = corners.round(_FINEST)
    segments = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)
    colours = np.broadcast_to(np.array(_FORMATION_COLOUR, np.uint8), segments.shape)
    return Lines(segments, colours, T_world_lines)


def merged_cloud(clouds: Mapping[int, Cloud], limit: int) -> Points | None:
    """Return all cameras' returns, each in its camera's colour; evenly thinned to the limit."""
    parts, colours, num_true = [], [], 0
    for camera, cloud in sorted(clouds.items()):
        if cloud.frame_id != WORLD:
            continue
        points = cloud.points_world()
        num_true += len(points)
        stride = max(1, -(-len(points) * len(clouds) // limit))
        parts.append(points[::stride].astype(np.float32))
        colour = np.array(camera_colour(camera), np.uint8)
        colours.append(np.broadcast_to(colour, parts[-1].shape))
    if not parts:
        return None
    return Points(
        np.concatenate(parts), np.concatenate(colours), _CLOUD_POINT_M, np.eye(4), num_true
    )
