"""What a camera is told, put into a message."""

from schemas.camera import CameraGoal, RobotGoal
from schemas.geometry import WORLD, Pose, Twist
from schemas.message import Message
from services.planner.wheels import Mounted, Robot


def camera_goal(stamp: Message, camera: int, mounted: Mounted) -> CameraGoal:
    """Return the goal of one camera at the instant of `stamp`."""
    view = mounted.view
    return CameraGoal(
        t_ns=stamp.t_ns,
        tick=stamp.tick,
        frame_id=WORLD,
        camera=camera,
        pose=Pose.from_matrix(view.T),
        twist=Twist(linear=tuple(view.linear.tolist()), angular=tuple(view.angular.tolist())),
        robot=None if mounted.robot is None else _robot_goal(mounted.robot),
    )


def _robot_goal(robot: Robot) -> RobotGoal:
    return RobotGoal(
        heading_rad=robot.heading_rad,
        v_mps=robot.v_mps,
        omega_rps=robot.omega_rps,
        v_dot=robot.v_dot,
        camera_yaw_rad=robot.camera_yaw_rad,
    )
