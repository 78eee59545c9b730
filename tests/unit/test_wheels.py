"""Robots with wheels below the cameras of a formation."""

import math

import numpy as np
import pytest

from services.kernels.rigid import apply, inverse, optical_yaw, planar, pose_error
from services.planner.motion import Motion
from services.planner.planar import PlanarMotion, Slots, robot_references, wrapped
from services.planner.ring import ring_angles
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.wheels import SLOWEST_MPS, Wheels, Wings, open_carrier
from services.world.path import open_motion

pytestmark = pytest.mark.unit

DT_S = 1 / 15
NUM = 6
RADIUS_M, ELEVATION_RAD = 0.8, 0.3
CAMERAS = tuple(range(NUM))
CIRCLE = Circle(
    CircleSettings(cameras=NUM, radius_m=RADIUS_M, elevation_rad=ELEVATION_RAD, centre_height_m=0.2)
)
LEVEL_M = RADIUS_M * math.cos(ELEVATION_RAD)
SEEDS = range(5)


def motion_of(state):
    linear, angular = state.twist()
    return Motion(state.pose(), np.array(linear), np.array(angular))


def still_at(x_m, heading_rad=0.0, v_mps=0.0):
    heading = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])
    return Motion(planar(x_m, 0.0, heading_rad), v_mps * heading, np.zeros(3))


def carried(carrier, target, t_s):
    return carrier.carry(CAMERAS, CIRCLE.plan(target, t_s).views, target, t_s)


def test_the_robots_of_the_circle_are_those_of_the_planar_formulas():
    path, wheels = open_motion("ellipse", (2.0, 1.6), 40.0), Wheels()
    for tick in range(600):
        state = path.at(tick * DT_S)
        mounted = carried(wheels, motion_of(state), tick * DT_S)
        expected = robot_references(
            PlanarMotion(
                *state.position_m,
                state.heading_rad,
                state.v_m_s,
                state.omega_rad_s,
                state.v_dot,
                state.omega_dot,
            ),
            Slots(LEVEL_M, ring_angles(NUM)),
        )
        robots = [each.robot for each in mounted]
        phi = np.array([robot.heading_rad for robot in robots])
        np.testing.assert_allclose(wrapped(phi - expected.phi_rad), 0.0, atol=1e-9)
        v = np.array([robot.v_mps for robot in robots])
        np.testing.assert_allclose(v, expected.v_mps, atol=1e-9)
        psi = np.array([robot.camera_yaw_rad for robot in robots])
        np.testing.assert_allclose(wrapped(psi - expected.psi_rad), 0.0, atol=2e-3)
        if tick > 10:  # Rates are differences, smoothed.
            omega = np.array([robot.omega_rps for robot in robots])
            np.testing.assert_allclose(omega, expected.omega_rps, atol=0.02)
            v_dot = np.array([robot.v_dot for robot in robots])
            np.testing.assert_allclose(v_dot, expected.v_dot, atol=0.02)


def test_the_mount_is_that_of_straight_driving_and_never_changes():
    wheels, path = Wheels(), open_motion("ellipse", (2.0, 1.6), 40.0)
    first = carried(wheels, motion_of(path.at(0.0)), 0.0)
    psi = [each.robot.camera_yaw_rad for each in first]
    np.testing.assert_allclose(wrapped(np.array(psi) - ring_angles(NUM) - np.pi), 0, atol=1e-9)
    for tick in range(1, 100):
        mounted = carried(wheels, motion_of(path.at(tick * DT_S)), tick * DT_S)
        assert [each.robot.camera_yaw_rad for each in mounted] == psi


@pytest.mark.parametrize("seed", SEEDS)
def test_the_view_is_where_it_was_turned_about_the_vertical_to_where_the_robot_points(seed):
    rng, wheels = np.random.default_rng(seed), Wheels()
    target = Motion(
        planar(*rng.normal(size=2), rng.normal()), np.array([*rng.normal(size=2), 0.0]), np.zeros(3)
    )
    views = CIRCLE.plan(target, 0.0).views
    for view, (turned, robot) in zip(views, carried(wheels, target, 0.0), strict=True):
        np.testing.assert_allclose(turned.T[:3, 3], view.T[:3, 3])
        assert turned.T[2, 2] == pytest.approx(view.T[2, 2])  # The tilt.
        yaw = robot.heading_rad + robot.camera_yaw_rad
        assert wrapped(np.array(optical_yaw(turned.T) - yaw)) == pytest.approx(0.0, abs=1e-9)


def test_straight_ahead_every_camera_looks_at_the_target_as_if_it_flew():
    target = still_at(0.4, heading_rad=0.7, v_mps=0.5)
    views = CIRCLE.plan(target, 0.0).views
    for view, mounted in zip(views, carried(Wheels(), target, 0.0), strict=True):
        assert max(pose_error(view.T, mounted.view.T)) < 1e-7
        centre = apply(inverse(mounted.view.T), apply(target.T, [0.0, 0.0, 0.2]))
        np.testing.assert_allclose(centre[:2], 0.0, atol=1e-9)


def test_a_target_that_stops_reverses_and_goes_on_never_turns_a_robot_around():
    wheels, x_m = Wheels(), 0.0
    for tick in range(300):
        v_mps = 0.5 * math.cos(tick * DT_S)
        x_m += v_mps * DT_S
        for _, robot in carried(wheels, still_at(x_m, v_mps=v_mps), tick * DT_S):
            assert abs(robot.heading_rad) < 1e-9
            assert robot.v_mps == pytest.approx(v_mps if abs(v_mps) >= SLOWEST_MPS else 0.0)
            assert abs(robot.omega_rps) < 1e-9


def test_a_target_that_stands_has_robots_that_wait_parallel_to_it():
    wheels = Wheels()
    for tick in range(3):
        for _, robot in carried(wheels, still_at(0.0, heading_rad=0.6), tick * DT_S):
            assert (robot.v_mps, robot.omega_rps, robot.v_dot) == (0.0, 0.0, 0.0)
            assert robot.heading_rad == pytest.approx(0.6)


def test_after_a_reset_the_robots_are_built_anew():
    wheels = Wheels()
    carried(wheels, still_at(0.0), 5.0)
    anew = carried(wheels, still_at(0.0, heading_rad=1.0), 0.0)
    assert anew[0].robot.heading_rad == pytest.approx(1.0)


def test_a_message_that_was_overtaken_does_not_build_the_robots_anew():
    wheels = Wheels()
    first = carried(wheels, still_at(0.0, v_mps=0.5), 5.0)
    late = carried(wheels, still_at(0.0, heading_rad=1.0, v_mps=0.5), 4.9)
    views = CIRCLE.plan(still_at(0.0), 5.1).views
    swapped = wheels.carry(CAMERAS, views[::-1], still_at(0.0, v_mps=0.5), 5.1)
    for mounted in (late, swapped):
        for one, other in zip(first, mounted, strict=True):
            assert one.robot.camera_yaw_rad == other.robot.camera_yaw_rad


def test_flying_cameras_have_the_views_as_they_are():
    target = still_at(0.0, v_mps=0.3)
    views = CIRCLE.plan(target, 0.0).views
    carrier = open_carrier("flying")
    assert isinstance(carrier, Wings)
    assert isinstance(open_carrier("unicycle"), Wheels)
    for view, mounted in zip(views, carried(carrier, target, 0.0), strict=True):
        assert mounted.robot is None
        assert mounted.view is not None
        np.testing.assert_array_equal(mounted.view.T, view.T)
