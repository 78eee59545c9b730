"""From goals to the commands of a robot with wheels."""

import numpy as np
import pytest

from schemas.camera import CameraGoal, RobotGoal
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody
from services.camera.controllers.planar import Posture, Velocity, driven, error_of
from services.camera.settings import CameraSettings
from services.camera.unicycle import UnicyclePilot, UnicycleSettings
from services.kernels.rigid import look_at, optical_yaw
from services.runtime.service import parse
from services.simulator.actuator import Actuator, Body, carried_out

pytestmark = pytest.mark.unit

DT_S = 1 / 15
PSI_RAD = 2.0
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
SPEED = Velocity(0.5, 0.2)


def camera_at(posture):
    """T_world_camera on a robot: 0.6 m up, turned by psi, looking down."""
    eye = np.array([posture.x_m, posture.y_m, 0.6])
    gaze = posture.phi_rad + PSI_RAD
    return look_at(eye, eye + [np.cos(gaze), np.sin(gaze), -0.4])


def reference(tick):
    """Where the robot shall be at a tick."""
    return driven(Posture(1.0, 0.2, 0.4), SPEED, tick * DT_S)


def goal(tick, robot=True):
    there = reference(tick + 1)
    drive = RobotGoal(
        heading_rad=there.phi_rad,
        v_mps=SPEED.v_mps,
        omega_rps=SPEED.omega_rps,
        v_dot=0.0,
        camera_yaw_rad=PSI_RAD,
    )
    return CameraGoal(
        t_ns=0,
        tick=tick,
        frame_id="world",
        camera=2,
        pose=Pose.from_matrix(camera_at(there)),
        twist=STILL,
        robot=drive if robot else None,
    )


def body_at(T_world_camera):
    return CameraBody(camera=2, pose=Pose.from_matrix(T_world_camera), twist=STILL)


def twist_of(command):
    return np.array([*command.linear, *command.angular])


@pytest.mark.parametrize("lag", [0, 1, 5])
def test_a_robot_on_its_reference_drives_as_the_reference_does_however_old_the_goal(lag):
    here = reference(20 + lag)
    command = UnicyclePilot(UnicycleSettings()).command(
        body_at(camera_at(here)), 20 + lag, goal(20), DT_S
    )
    heading = [np.cos(here.phi_rad), np.sin(here.phi_rad), 0.0]
    np.testing.assert_allclose(command.linear, 0.5 * np.array(heading), atol=1e-9)
    np.testing.assert_allclose(command.angular, [0.0, 0.0, 0.2], atol=1e-9)


@pytest.mark.parametrize(
    "controller", ["kanayama", "samson", "morin_samson", "dynamic_feedback", "input_output"]
)
def test_the_simulated_robot_comes_to_its_goals_and_no_command_points_sideways(controller):
    pilot = UnicyclePilot(UnicycleSettings(controller=controller))
    actuator = Actuator(2.0, 3.0, "unicycle", lag_s=0.1)
    body = Body(camera_at(Posture(0.7, 0.5, 0.1)), np.zeros(6), PSI_RAD)
    for tick in range(300):
        command = twist_of(pilot.command(body_at(body.T_world_camera), tick, goal(tick), DT_S))
        step = carried_out(actuator, body, command, 2, tick, DT_S)
        assert not step.sideways
        assert not step.clipped
        body = step.body
    x_m, y_m = body.T_world_camera[:2, 3]
    phi_rad = optical_yaw(body.T_world_camera) - PSI_RAD
    error = error_of(Posture(x_m, y_m, phi_rad), reference(300))
    # A lag puts a robot on an arc slightly off it.
    assert np.hypot(error.x_m, error.y_m) < 0.01
    assert abs(error.phi_rad) < 0.03


def test_a_goal_that_is_never_renewed_comes_to_a_stand():
    pilot = UnicyclePilot(UnicycleSettings())
    body = Body(camera_at(reference(0)), np.zeros(6), PSI_RAD)
    actuator = Actuator(2.0, 3.0, "unicycle")
    for tick in range(150):
        command = twist_of(pilot.command(body_at(body.T_world_camera), tick, goal(0), DT_S))
        body = carried_out(actuator, body, command, 2, tick, DT_S).body
    assert np.linalg.norm(body.twist) < 1e-3
    last = driven(reference(1), SPEED, 0.5)
    assert np.hypot(*(body.T_world_camera[:2, 3] - [last.x_m, last.y_m])) < 0.1


def test_a_goal_without_a_robot_is_objected_to_and_the_robot_stands():
    pilot = UnicyclePilot(UnicycleSettings())
    assert pilot.objection(goal(3)) is None
    assert "planner with drive unicycle" in pilot.objection(goal(3, robot=False))
    command = pilot.command(body_at(camera_at(reference(0))), 3, goal(3, robot=False), DT_S)
    assert not twist_of(command).any()


def test_drive_controller_limits_and_gains_are_flags():
    flags = "--drive unicycle --unicycle.controller samson --unicycle.max-speed-mps 0.4"
    settings = parse(CameraSettings, "camera", [*flags.split(), "--unicycle.samson.b", "2"])
    assert isinstance(settings.pilot(), UnicyclePilot)
    assert settings.unicycle.max_speed_mps == 0.4
    assert settings.unicycle.gains() == settings.unicycle.samson
    assert settings.unicycle.samson.b == 2.0
