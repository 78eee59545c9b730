"""Where the target is: from the simulator, or from a tracker."""

from schemas.geometry import Pose, Twist
from schemas.message import Message


class TargetPose(Message):
    """`target` in `world`: origin on the ground below the target, x forward, z up."""

    pose: Pose
    twist: Twist
    """World axes."""
