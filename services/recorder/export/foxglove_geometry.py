"""Times, poses and frames in Foxglove's words."""

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from schemas.geometry import Pose

_SECOND_NS = 1_000_000_000


def optical_frame(camera: int) -> str:
    """Return the frame of a camera: x right, y down, z forward."""
    return f"cam_{camera}_optical"


def timestamp(t_ns: int) -> Timestamp:
    """Return a time."""
    return Timestamp(seconds=t_ns // _SECOND_NS, nanos=t_ns % _SECOND_NS)


def foxglove_pose(pose: Pose) -> FoxglovePose:
    """Return a pose in Foxglove's words."""
    x, y, z = pose.position
    a, b, c, d = pose.orientation
    return FoxglovePose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=d))


def pose_in_frame(stamp: Timestamp, frame: str, pose: Pose) -> PoseInFrame:
    """Return a pose in a frame."""
    return PoseInFrame(timestamp=stamp, frame_id=frame, pose=foxglove_pose(pose))


def transform(stamp: Timestamp, parent: str, child: str, pose: Pose) -> FrameTransform:
    """Return where the frame `child` is in `parent`."""
    there = foxglove_pose(pose)
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=there.position,
        rotation=there.orientation,
    )


def no_motion() -> FoxglovePose:
    """Return the pose of a frame in itself."""
    return FoxglovePose(position=Vector3(), orientation=Quaternion(w=1.0))
