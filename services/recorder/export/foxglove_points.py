"""Points in Foxglove's words."""

from typing import Any

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from schemas.geometry import WORLD
from services.recorder.export.foxglove_geometry import (
    foxglove_pose,
    no_motion,
    optical_frame,
    timestamp,
)
from services.runtime.map_mirror import MapMirror

_NUMERIC = {"<f4": PackedElementField.FLOAT32, "|u1": PackedElementField.UINT8}


def map_cloud(mirror: MapMirror, rgba: NDArray[np.uint8], t_ns: int) -> PointCloud:
    """Return the centres of the occupied voxels, each with a colour (N, 4), posed in `world`."""
    fields = [(name, "<f4") for name in "xyz"]
    fields += [(name, "|u1") for name in ("red", "green", "blue", "alpha")]
    points = np.empty(len(mirror), fields)
    for name, column in zip("xyz", mirror.centres().T, strict=True):
        points[name] = column
    for name, column in zip(("red", "green", "blue", "alpha"), rgba.T, strict=True):
        points[name] = column
    assert mirror.latest is not None
    return _cloud(timestamp(t_ns), WORLD, foxglove_pose(mirror.latest.pose), points)


def camera_cloud(stamp: Timestamp, camera: int, points_m: NDArray[Any]) -> PointCloud:
    """Return (N, 3) points of a camera's optical frame, metres."""
    table = np.ascontiguousarray(points_m, "<f4").view([(name, "<f4") for name in "xyz"])
    return _cloud(stamp, optical_frame(camera), no_motion(), table.reshape(-1))


def _cloud(
    stamp: Timestamp, frame: str, pose: FoxglovePose, points: NDArray[np.void]
) -> PointCloud:
    """Return (N,) points whose fields are numbers."""
    fields = points.dtype.fields
    assert fields is not None
    return PointCloud(
        timestamp=stamp,
        frame_id=frame,
        pose=pose,
        point_stride=points.dtype.itemsize,
        fields=[
            PackedElementField(name=name, offset=at[1], type=_NUMERIC[at[0].str])
            for name, at in fields.items()
        ],
        data=points.tobytes(),
    )
