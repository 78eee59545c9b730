"""What a camera's robot makes of its command."""

import numpy as np
import pytest

from services.kernels.rigid import integrate_twist, look_at, optical_yaw, planar
from services.simulator.actuator import Actuator, Body, carried_out

pytestmark = pytest.mark.unit

DT_S = 1 / 15
SEEDS = range(8)


def wheels(**settings):
    return Actuator(speed_m_s=2.0, turn_rad_s=3.0, drive="unicycle", **settings)


def robot(rng, yaw_rad=None):
    """A robot somewhere, its camera looking slightly down."""
    eye = np.array([*rng.normal(size=2), 0.6])
    gaze = rng.uniform(-np.pi, np.pi)
    T = look_at(eye, eye + [np.cos(gaze), np.sin(gaze), -0.3])
    return Body(T, np.zeros(6), rng.uniform(-3, 3) if yaw_rad is None else yaw_rad)


def along(body, v, omega):
    return np.array([*(v * body.heading()), 0.0, 0.0, omega])


def run(actuator, body, command, ticks, camera=0):
    for tick in range(ticks):
        body = carried_out(actuator, body, command(body), camera, tick, DT_S).body
    return body


@pytest.mark.parametrize("seed", SEEDS)
def test_wheels_drive_an_arc_and_the_camera_keeps_its_height_tilt_and_place(seed):
    rng = np.random.default_rng(seed)
    body = robot(rng)
    v, omega = rng.uniform(-1.5, 1.5, 2)
    step = carried_out(wheels(), body, along(body, v, omega), 0, 0, DT_S)
    # The same arc, driven by a frame on the ground in ten thousand straight pieces.
    T_world_camera = body.T_world_camera
    phi = optical_yaw(T_world_camera) - body.camera_yaw_rad
    T_world_robot = planar(*T_world_camera[:2, 3], phi)
    T_robot_camera = np.linalg.inv(T_world_robot) @ T_world_camera
    for _ in range(10_000):
        linear = v * T_world_robot[:3, 0]
        T_world_robot = integrate_twist(T_world_robot, linear, [0, 0, omega], DT_S / 10_000)
    np.testing.assert_allclose(step.body.T_world_camera, T_world_robot @ T_robot_camera, atol=1e-5)
    np.testing.assert_allclose(step.body.heading(), T_world_robot[:3, 0], atol=1e-5)
    assert not step.sideways
    assert not step.clipped


@pytest.mark.parametrize("seed", SEEDS)
def test_what_wheels_cannot_do_is_left_out_and_counted(seed):
    rng = np.random.default_rng(seed)
    body = robot(rng)
    aside = np.cross([0, 0, 1], body.heading())
    good = along(body, 0.5, 0.4)
    expected = carried_out(wheels(), body, good, 0, 0, DT_S)
    for wrong in ([*(0.1 * aside), 0, 0, 0], [0, 0, 0.1, 0, 0, 0], [0, 0, 0, 0.1, 0.1, 0]):
        step = carried_out(wheels(), body, good + wrong, 0, 0, DT_S)
        np.testing.assert_allclose(step.body.T_world_camera, expected.body.T_world_camera)
        assert step.sideways
    # A command for the heading of a tick ago is as meant.
    assert not carried_out(wheels(), body, good + [*(0.02 * aside), 0, 0, 0], 0, 0, DT_S).sideways
    assert not carried_out(Actuator(2.0, 3.0), body, good + [*aside, 0, 0, 0], 0, 0, DT_S).sideways


@pytest.mark.parametrize("drive", ["flying", "unicycle"])
@pytest.mark.parametrize("lag_s", [0.02, 0.2, 3.0])
def test_a_velocity_follows_its_command_with_the_time_constant(drive, lag_s):
    actuator = Actuator(2.0, 3.0, drive, lag_s=lag_s)
    body = robot(np.random.default_rng(1), yaw_rad=0.3)
    start, heading, ticks = body.T_world_camera[:3, 3], body.heading(), 9
    body = run(actuator, body, lambda at: along(at, 1.0, 0.0), ticks)
    t_s = ticks * DT_S
    np.testing.assert_allclose(body.twist[:3], heading * (1 - np.exp(-t_s / lag_s)), atol=1e-9)
    way_m = t_s - lag_s * (1 - np.exp(-t_s / lag_s))
    np.testing.assert_allclose(body.T_world_camera[:3, 3] - start, heading * way_m, atol=1e-9)


def test_on_wheels_the_velocity_turns_with_the_robot_while_it_lags():
    actuator, body = wheels(lag_s=0.5), robot(np.random.default_rng(2))
    body = run(actuator, body, lambda at: along(at, 1.0, 1.0), 40)
    speed = float(body.twist[:3] @ body.heading())
    assert speed > 0.9
    np.testing.assert_allclose(body.twist[:3], speed * body.heading(), atol=1e-9)


@pytest.mark.parametrize("drive", ["flying", "unicycle"])
def test_limits_hold_and_are_counted(drive):
    actuator = Actuator(0.5, 0.2, drive)
    body = robot(np.random.default_rng(3))
    step = carried_out(actuator, body, along(body, -2.0, 1.0), 0, 0, DT_S)
    assert step.clipped
    assert np.linalg.norm(step.body.twist[:3]) == pytest.approx(0.5)
    assert step.body.twist[5] == pytest.approx(0.2)
    assert not carried_out(actuator, body, along(body, 0.4, 0.1), 0, 0, DT_S).clipped


@pytest.mark.parametrize("drive", ["flying", "unicycle"])
def test_noise_has_the_size_that_is_set_and_is_drawn_from_seed_camera_and_tick(drive):
    actuator = Actuator(2.0, 3.0, drive, noise_m_s=0.3, noise_rad_s=0.2, seed=5)
    body = Body(look_at([0, 0, 0.5], [1, 0, 0.5]), np.zeros(6))

    def moved(actuator, camera, tick):
        after = carried_out(actuator, body, np.zeros(6), camera, tick, DT_S).body
        way = after.T_world_camera[:2, 3] / DT_S
        return np.array([*way, optical_yaw(after.T_world_camera) / DT_S])

    samples = np.array(
        [moved(actuator, camera, tick) for camera in range(4) for tick in range(400)]
    )
    # On wheels a camera slips along its heading alone, here x.
    expected = [0.3, 0.3 if drive == "flying" else 0.0, 0.2]
    np.testing.assert_allclose(samples.std(axis=0), expected, rtol=0.07, atol=0.01)
    np.testing.assert_allclose(samples.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_array_equal(moved(actuator, 2, 7), moved(actuator, 2, 7))
    other = Actuator(2.0, 3.0, drive, noise_m_s=0.3, noise_rad_s=0.2, seed=6)
    for different in (moved(other, 2, 7), moved(actuator, 3, 7), moved(actuator, 2, 8)):
        assert (different != moved(actuator, 2, 7)).any()
