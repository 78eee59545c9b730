"""Our messages as Foxglove's, which Foxglove, Lichtblick and Rerun know.

Frames are `world`, `target` and `cam_<i>_optical`; positions and orientations go over unchanged.
"""

from typing import Any, NamedTuple, assert_never

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from schemas.camera import CameraGoal, CameraInfo, CameraPose, ColorImage, Intrinsics
from schemas.cloud import INVALID, NO_RETURN, DepthCloud, XyzCloud
from schemas.formation import Formation
from schemas.geometry import WORLD
from schemas.target import TargetEstimate, TargetPose
from services.recorder.export.foxglove_geometry import (
    no_motion,
    optical_frame,
    pose_in_frame,
    timestamp,
    transform,
)
from services.recorder.export.foxglove_points import camera_cloud

_MILLIMETRE_M = 1e-3
_FORMATION_RGBA = (0.835, 0.369, 0.0, 0.9)  # Okabe's and Ito's vermilion.
_FORMATION_PX = 2.0


Convertible = (
    TargetPose | TargetEstimate | CameraGoal | CameraPose | CameraInfo | ColorImage
    | DepthCloud | XyzCloud | Formation
)  # fmt: skip


class Said(NamedTuple):
    """A message of Foxglove's and the topic it goes under."""

    topic: str
    message: Any


def converted(message: Convertible, t_ns: int, pixel_step: int) -> list[Said]:
    """Return what a message of ours is in Foxglove's words.

    Args:
        message: of ours.
        t_ns: its time.
        pixel_step: of a depth image, every so many-th pixel of every so many-th row is also given
            as a point; 0: none.
    """
    stamp = timestamp(t_ns)
    match message:
        case TargetPose():
            return [
                Said("/tf", transform(stamp, WORLD, "target", message.pose)),
                Said("/target/pose", pose_in_frame(stamp, WORLD, message.pose)),
            ]
        case TargetEstimate():
            return [Said("/target/estimate", pose_in_frame(stamp, WORLD, message.pose))]
        case CameraGoal():
            pose = pose_in_frame(stamp, WORLD, message.pose)
            return [Said(f"/cams/{message.camera}/goal", pose)]
        case CameraPose():
            frame = optical_frame(message.camera)
            return [
                Said("/tf", transform(stamp, message.frame_id, frame, message.pose)),
                Said(
                    f"/cams/{message.camera}/pose",
                    pose_in_frame(stamp, message.frame_id, message.pose),
                ),
            ]
        case CameraInfo():
            return [_calibration(stamp, message.camera, message.intrinsics)]
        case ColorImage():
            return [_color(stamp, message)]
        case DepthCloud():
            return _depth(stamp, message, pixel_step)
        case XyzCloud():
            points = message.array
            cloud = np.ascontiguousarray(points[np.isfinite(points).all(axis=1)])
            return [_capture(stamp, message), _points(stamp, message.camera, cloud)]
        case Formation():
            return [Said("/formation", _polygon(stamp, message))]
        case _:
            assert_never(message)


def depth_millimetres(cloud: DepthCloud) -> NDArray[np.uint16]:
    """Return the depth image as others expect it: (H, W) millimetres, 0 = nothing known."""
    depth = np.where(cloud.array == NO_RETURN, INVALID, cloud.array)
    if cloud.depth_scale_m != _MILLIMETRE_M:
        scaled = np.rint(depth * (cloud.depth_scale_m / _MILLIMETRE_M))
        depth = np.where(scaled < NO_RETURN, scaled, INVALID)
    return depth.astype("<u2")


def _depth(stamp: Timestamp, cloud: DepthCloud, pixel_step: int) -> list[Said]:
    depth, k = depth_millimetres(cloud), cloud.intrinsics
    image = RawImage(
        timestamp=stamp,
        frame_id=optical_frame(cloud.camera),
        width=k.width,
        height=k.height,
        encoding="16UC1",
        step=2 * k.width,
        data=depth.tobytes(),
    )
    said = [
        _capture(stamp, cloud),
        _calibration(stamp, cloud.camera, k),
        Said(f"/cams/{cloud.camera}/depth", image),
    ]
    if pixel_step:
        v, u = np.nonzero(depth[::pixel_step, ::pixel_step])
        v, u = v * pixel_step, u * pixel_step
        z = depth[v, u] * _MILLIMETRE_M
        points = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=1)
        said.append(_points(stamp, cloud.camera, points))
    return said


def _capture(stamp: Timestamp, cloud: DepthCloud | XyzCloud) -> Said:
    frame = optical_frame(cloud.camera)
    return Said("/tf", transform(stamp, cloud.frame_id, frame, cloud.pose))


def _calibration(stamp: Timestamp, camera: int, k: Intrinsics) -> Said:
    K = [k.fx, 0, k.cx, 0, k.fy, k.cy, 0, 0, 1]
    message = CameraCalibration(
        timestamp=stamp,
        frame_id=optical_frame(camera),
        width=k.width,
        height=k.height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=K,
        R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        P=[*K[:3], 0, *K[3:6], 0, *K[6:], 0],
    )
    return Said(f"/cams/{camera}/calibration", message)


def _color(stamp: Timestamp, image: ColorImage) -> Said:
    message = CompressedImage(
        timestamp=stamp,
        frame_id=optical_frame(image.camera),
        data=image.array.tobytes(),
        format="jpeg",
    )
    return Said(f"/cams/{image.camera}/color", message)


def _points(stamp: Timestamp, camera: int, points_m: NDArray[Any]) -> Said:
    return Said(f"/cams/{camera}/points", camera_cloud(stamp, camera, points_m))


def _polygon(stamp: Timestamp, formation: Formation) -> SceneUpdate:
    """Return the formation's polygon; the next one takes its place, also an empty one."""
    r, g, b, a = _FORMATION_RGBA
    line = LinePrimitive(
        type=LinePrimitive.LINE_LOOP,
        pose=no_motion(),
        thickness=_FORMATION_PX,
        scale_invariant=True,
        points=[Point3(x=x, y=y, z=z) for x, y, z in formation.polygon],
        color=Color(r=r, g=g, b=b, a=a),
    )
    entity = SceneEntity(
        timestamp=stamp,
        frame_id=WORLD,
        id="formation",
        lifetime=Duration(),
        lines=[line] if formation.polygon else [],
    )
    return SceneUpdate(entities=[entity])
