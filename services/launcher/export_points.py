"""A moment of a recording as points: the occupied voxels, or what the cameras saw."""

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import BRICK, UNKNOWN, VOXELS
from services.kernels.palette import VIRIDIS, colours
from services.kernels.rigid import apply
from services.mapper.box import Box
from services.mapper.ply_file import ply_bytes, vertex_bytes
from services.mapper.sensor_model import SensorModel
from services.mapper.stored_map import StoredMap, box_of
from services.recorder.export.errors import ExportError
from services.recorder.export.moment import Moment

_RGB = ("red", "green", "blue")


def voxel_ply(moment: Moment) -> tuple[bytes, int]:
    """Return the occupied voxels as a PLY in the map's frame, and how many they are.

    What is recorded of a voxel is its class: all have the probability of one hit. Colours tell
    the height above the ground.

    Raises:
        ExportError: If no map was known yet.
        MapperError: If no map of ours can hold it.
    """
    stored = stored_map(moment)
    return ply_bytes(stored), len(moment.mirror)


def stored_map(moment: Moment) -> StoredMap:
    """Return the occupied voxels as a map.

    Raises:
        ExportError: If no map was known yet.
        MapperError: If no map of ours can hold it.
    """
    latest = moment.mirror.latest
    if latest is None:
        raise ExportError(f"no map was known {moment.elapsed_s:.3f} s after the first instant")
    size_m = latest.resolution_m
    first_key = np.rint(np.asarray(latest.origin) / size_m)
    num_bricks = -(-np.asarray(latest.shape_voxels) // BRICK)
    box: Box = box_of(size_m, first_key, num_bricks)
    voxels = moment.mirror.voxels
    bricks, rows = np.unique(voxels // BRICK, axis=0, return_inverse=True)
    rows, inside = rows.reshape(-1), voxels % BRICK @ (BRICK * BRICK, BRICK, 1)
    sensor = SensorModel()
    log_odds = np.full((len(bricks), VOXELS), UNKNOWN, np.int16)
    log_odds[rows, inside] = sensor.fixed_point()[0]
    color = np.full((len(bricks), VOXELS, 3), 255, np.uint8)
    color[rows, inside] = _by_height(apply(moment.T_world_map, moment.mirror.centres())[:, 2])
    return StoredMap(box, sensor, bricks.astype(np.int16), log_odds, color)


def cloud_ply(moment: Moment) -> tuple[bytes, int]:
    """Return all returns of the instant's clouds as a PLY in the world, and how many they are.

    Besides position and colour (of the height) each point tells its camera.

    Raises:
        ExportError: If no cloud was there yet.
    """
    clouds = moment.clouds_of_the_instant()
    if not clouds:
        raise ExportError(f"no cloud was there {moment.elapsed_s:.3f} s after the first instant")
    points = [cloud.points_world() for cloud in clouds]
    together = np.concatenate(points)
    fields = [(name, "<f4") for name in "xyz"] + [(name, "|u1") for name in (*_RGB, "camera")]
    vertices = np.empty(len(together), fields)
    for name, column in zip("xyz", together.T, strict=True):
        vertices[name] = column
    for name, column in zip(_RGB, _by_height(together[:, 2]).T, strict=True):
        vertices[name] = column
    vertices["camera"] = np.repeat([cloud.camera for cloud in clouds], [len(p) for p in points])
    comment = f"encircle: returns of {len(clouds)} cameras at tick {clouds[0].tick}, metres, world"
    return vertex_bytes(vertices, comment), len(vertices)


def _by_height(heights_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return (N, 3) colours of heights (N,) above the ground."""
    top_m = max(float(heights_m.max(initial=0.0)), 1e-9)
    rgb: NDArray[np.uint8] = np.rint(255 * colours(VIRIDIS, heights_m / top_m)).astype(np.uint8)
    return rgb
