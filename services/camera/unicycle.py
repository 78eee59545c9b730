"""The pilot of a camera that is fixed on a robot with wheels."""

import math
from typing import Annotated, Literal, assert_never

from pydantic import Field

from schemas.camera import CameraGoal, RobotGoal
from schemas.geometry import Twist
from schemas.sim import CameraBody
from services.camera.controllers.controller import UnicycleLimits
from services.camera.controllers.delayed import Delayed
from services.camera.controllers.dynamic_feedback import DynamicFeedbackGains
from services.camera.controllers.input_output import InputOutputGains
from services.camera.controllers.kanayama import KanayamaGains
from services.camera.controllers.morin_samson import MorinSamsonGains
from services.camera.controllers.open import ControllerGains, open_controller
from services.camera.controllers.planar import Drive, Posture, Velocity, driven
from services.camera.controllers.samson import SamsonGains
from services.camera.pilot import coast
from services.kernels.rigid import optical_yaw

ControllerName = Literal["kanayama", "samson", "morin_samson", "dynamic_feedback", "input_output"]


class UnicycleSettings(UnicycleLimits):
    """The robot, and who steers it."""

    controller: ControllerName = "kanayama"
    """Which tracking law."""
    delay_s: Annotated[float, Field(ge=0, le=2)] = 0.0
    """Age of the pose that the robot is told; it is predicted to the present, s."""
    kanayama: KanayamaGains = KanayamaGains()
    samson: SamsonGains = SamsonGains()
    morin_samson: MorinSamsonGains = MorinSamsonGains()
    dynamic_feedback: DynamicFeedbackGains = DynamicFeedbackGains()
    input_output: InputOutputGains = InputOutputGains()

    def gains(self) -> ControllerGains:
        """Return those of the chosen controller."""
        match self.controller:
            case "kanayama":
                return self.kanayama
            case "samson":
                return self.samson
            case "morin_samson":
                return self.morin_samson
            case "dynamic_feedback":
                return self.dynamic_feedback
            case "input_output":
                return self.input_output
            case _:
                assert_never(self.controller)


class UnicyclePilot:
    """Drives the robot along its reference; the camera looks where the robot takes it."""

    def __init__(self, settings: UnicycleSettings) -> None:
        self._steering = Delayed(open_controller(settings.gains(), settings), settings.delay_s)

    def objection(self, goal: CameraGoal) -> str | None:
        """A goal must say how the robot shall drive."""
        if goal.robot is None:
            return "robot: None; a camera with drive unicycle needs a planner with drive unicycle"
        return None

    def command(self, body: CameraBody, tick: int, goal: CameraGoal, dt_s: float) -> Twist:
        """Return the velocity for the time from `tick` to the next, world axes; else stand."""
        if goal.robot is None:
            return _twist(0.0, Velocity(0.0, 0.0))
        phi_rad = optical_yaw(body.pose.matrix()) - goal.robot.camera_yaw_rad
        robot = Posture(body.pose.position[0], body.pose.position[1], phi_rad)
        # The goal is for the instant after its own; the law is steered by the present.
        coasting = coast(tick - 1, goal.tick, dt_s)
        drive = _drive(goal.robot)
        there = Posture(goal.pose.position[0], goal.pose.position[1], goal.robot.heading_rad)
        reference = driven(there, Velocity(drive.v_mps, drive.omega_rps), coasting.time_s)
        drive = Drive(0.0, 0.0) if coasting.stands else drive
        return _twist(phi_rad, self._steering.steer(robot, reference, drive, dt_s))


def _drive(robot: RobotGoal) -> Drive:
    return Drive(robot.v_mps, robot.omega_rps, robot.v_dot)


def _twist(phi_rad: float, velocity: Velocity) -> Twist:
    v = velocity.v_mps
    return Twist(
        linear=(v * math.cos(phi_rad), v * math.sin(phi_rad), 0.0),
        angular=(0.0, 0.0, velocity.omega_rps),
    )
