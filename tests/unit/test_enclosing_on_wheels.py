"""Planner, pilots and simulated robots, tick by tick, without a bus and without pictures.

A scene to scale: cameras see 40 degrees to each side, of which 2 are margin, a target of radius
0.2 m, semi-axes of 4 m and 3.2 m (kappa_max = a / b^2 = 0.39 / m).
"""

import math

import numpy as np
import pytest

from schemas.camera import CameraGoal
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody
from schemas.target import TargetPose
from services.camera.unicycle import UnicyclePilot, UnicycleSettings
from services.kernels.rigid import apply, inverse
from services.planner.goals import camera_goal
from services.planner.motion import Motion
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.wheels import open_carrier
from services.simulator.actuator import Actuator
from services.simulator.messages import target_pose
from services.simulator.world_state import World
from services.world.path import open_motion

pytestmark = pytest.mark.unit

NUM, RADIUS_M, DT_NS = 6, 0.8, 66_666_667
DT_S = DT_NS * 1e-9
CAMERAS = tuple(range(NUM))
BETA_RAD = math.radians(40)
ROOM_RAD = BETA_RAD - math.radians(2) - math.asin(0.2 / RADIUS_M)
"""The whole target is in view, with margin."""
CENTRE = np.array([0.0, 0.0, 0.2])
CONTROLLERS = ["kanayama", "samson", "morin_samson", "dynamic_feedback", "input_output"]


class Enclosing:
    """A world in which a planner leads unicycles around a target."""

    def __init__(self, controller="kanayama", radius_m=RADIUS_M, **actuator):
        motion = open_motion("ellipse", (4.0, 3.2), 60.0)
        self.world = World(motion, DT_NS, Actuator(2.0, 3.0, "unicycle", **actuator))
        settings = UnicycleSettings(controller=controller)
        self._pilots = [UnicyclePilot(settings) for _ in CAMERAS]
        self._carrier = open_carrier("unicycle")
        self._circle = Circle(
            CircleSettings(
                cameras=NUM, radius_m=radius_m, elevation_rad=0.0, centre_height_m=CENTRE[2]
            )
        )
        self.goals = self._plan()
        for goal in self.goals:
            self.world.spawn(goal.camera, goal.pose.matrix(), goal.robot.camera_yaw_rad)

    def _plan(self) -> list[CameraGoal]:
        pose: TargetPose = target_pose(self.world)
        linear, angular = np.array(pose.twist.linear), np.array(pose.twist.angular)
        target = Motion(pose.pose.matrix(), linear, angular).predicted(DT_S)
        t_s = pose.t_ns * 1e-9 + DT_S
        views = self._circle.plan(target, t_s).views
        mounted = self._carrier.carry(CAMERAS, views, target, t_s)
        return [camera_goal(pose, camera, each) for camera, each in enumerate(mounted)]

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Go on for a tick; return bearings (N,) and errors of position (N,) at its end."""
        self.goals = self._plan()
        commands = {}
        for goal, pilot in zip(self.goals, self._pilots, strict=True):
            body = self.world.cameras[goal.camera]
            linear, angular = tuple(body.twist[:3]), tuple(body.twist[3:])
            told = CameraBody(
                camera=goal.camera,
                pose=Pose.from_matrix(body.T_world_camera),
                twist=Twist(linear=linear, angular=angular),
            )
            twist = pilot.command(told, self.world.tick, goal, DT_S)
            commands[goal.camera] = np.array([*twist.linear, *twist.angular])
        self.world.advance(commands)
        return self.bearings(), self.errors()

    def bearings(self) -> np.ndarray:
        centre = apply(self.world.target().pose(), CENTRE)
        seen = [apply(inverse(self.world.cameras[i].T_world_camera), centre) for i in CAMERAS]
        return np.array([math.atan2(x, z) for x, _, z in seen])

    def errors(self) -> np.ndarray:
        at = np.array([self.world.cameras[i].T_world_camera[:2, 3] for i in CAMERAS])
        wanted = np.array([goal.pose.position[:2] for goal in self.goals])
        return np.linalg.norm(at - wanted, axis=1)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_six_unicycles_keep_a_target_on_an_ellipse_in_view_for_a_lap(controller):
    enclosing = Enclosing(controller)
    bearings, errors = zip(*(enclosing.step() for _ in range(900)), strict=True)
    assert np.abs(bearings).max() <= ROOM_RAD
    settled = np.array(errors)[150:]
    assert math.sqrt((settled**2).mean()) < 5e-3
    assert settled.max() < 8e-3
    assert enclosing.world.num_sideways == 0
    assert enclosing.world.num_clipped == 0


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_lag_and_slip_do_not_lose_it(controller):
    enclosing = Enclosing(controller, lag_s=0.15, noise_m_s=0.02, noise_rad_s=0.05, seed=4)
    bearings, errors = zip(*(enclosing.step() for _ in range(600)), strict=True)
    assert np.abs(bearings).max() <= ROOM_RAD + math.radians(2)
    assert math.sqrt((np.array(errors)[60:] ** 2).mean()) < 0.02


def test_too_far_out_it_is_lost_for_wheels_cannot_follow():
    """What feasibility says: d <= sin(beta) / kappa_max, here 1.65 m; some more for so few."""
    enclosing = Enclosing(radius_m=2.2)
    bearings = np.array([enclosing.step()[0] for _ in range(600)])
    assert np.abs(bearings[150:]).max() > BETA_RAD
