"""The occupied voxels of a map as squares that can be drawn."""

import numpy as np
from numpy.typing import NDArray

from services.kernels import cubes
from services.kernels.light import Squares
from services.kernels.palette import colours, linear
from services.kernels.rigid import FloatArray, apply
from services.recorder.export.errors import ExportError
from services.recorder.export.theme import Theme
from services.runtime.map_mirror import MapMirror

_REACH = 3
"""Voxels: how far around a voxel its neighbours tell which way the surface looks."""
_MAX_CELLS = 1 << 28
_GROUND_VOXELS = 1.2
"""What does not reach higher above the ground, in voxels, is the ground."""


def voxel_squares(
    mirror: MapMirror, T_world_map: FloatArray, top_m: float, theme: Theme
) -> Squares:
    """Return the faces of the voxels that something can be seen of.

    Args:
        mirror: the map.
        T_world_map: (4, 4).
        top_m: the height that has the palette's last colour.
        theme: colours.

    Raises:
        ExportError: If the voxels spread over too much space.
    """
    voxels = mirror.voxels
    if mirror.latest is None or not len(voxels):
        return no_squares()
    lowest, highest = voxels.min(axis=0), voxels.max(axis=0)
    shape = highest - lowest + 3
    if int(np.prod(shape)) > _MAX_CELLS:
        raise ExportError(
            f"the occupied voxels span {' x '.join(map(str, shape))} voxels; at most {_MAX_CELLS} "
            "can be drawn"
        )
    voxels = voxels - lowest
    cells = np.zeros(tuple(shape), np.uint8)
    cubes.mark(voxels, cells)
    num_faces = cubes.count_faces(voxels, cells)
    corners = np.empty((num_faces, 4, 3), np.int32)
    voxel = np.empty(num_faces, np.int32)
    crowding = np.empty((num_faces, 4), np.uint8)
    cubes.faces(voxels, cells, corners, voxel, crowding)
    size_m = mirror.latest.resolution_m
    origin_m = np.asarray(mirror.latest.origin) + lowest * size_m
    centres_m = apply(T_world_map, origin_m + (voxels + 0.5) * size_m)
    normals = _normals(voxels, cells) @ T_world_map[:3, :3].T
    rgb = voxel_colours(centres_m, size_m, top_m, theme)
    return Squares(
        corners_m=apply(T_world_map, origin_m + corners * size_m).astype(np.float32),
        normal=normals[voxel].astype(np.float32),
        rgb=rgb[voxel].astype(np.float32),
        crowding=crowding,
    )


def no_squares() -> Squares:
    """Return what there is to draw of an empty map."""
    none = np.empty((0, 3), np.float32)
    return Squares(np.empty((0, 4, 3), np.float32), none, none, np.empty((0, 4), np.uint8))


def voxel_colours(
    centres_m: FloatArray, size_m: float, top_m: float, theme: Theme
) -> NDArray[np.float64]:
    """Return the light (N, 3) of voxels at centres (N, 3), world: by height, the ground plain."""
    rgb = linear(colours(theme.palette, centres_m[:, 2] / max(top_m, 1e-9)))
    rgb[is_ground(centres_m, size_m)] = theme.ground_voxel
    return rgb


def is_ground(centres_m: FloatArray, size_m: float) -> NDArray[np.bool_]:
    """Return (N,) which voxels at centres (N, 3), world, are of the ground z = 0."""
    ground: NDArray[np.bool_] = centres_m[:, 2] + 0.5 * size_m <= _GROUND_VOXELS * size_m
    return ground


def _normals(voxels: NDArray[np.int64], cells: NDArray[np.uint8]) -> FloatArray:
    """Return (N, 3) across the surface that the voxels lie on, either sign."""
    matrices = np.empty((len(voxels), 3, 3))
    cubes.scatter(voxels, cells, _REACH, matrices)
    normals: FloatArray = np.linalg.eigh(matrices)[1][:, :, 0]
    return normals
