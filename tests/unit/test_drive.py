"""Laws of the camera's drive."""

import numpy as np
import pytest

from services.camera.drive import DriveLimits, follow
from services.kernels.rigid import integrate_twist, look_at, pose_error, rotation_exp

pytestmark = pytest.mark.unit

DT = 1 / 15
LIMITS = DriveLimits()
UNLIMITED = DriveLimits(max_speed_mps=1e9, max_turn_rps=1e9, max_acceleration_mps2=1e12)
STILL = np.zeros(3)
SEEDS = range(10)


def random_pose(rng):
    T = np.eye(4)
    T[:3, :3] = rotation_exp(rng.normal(size=3) * 2)
    T[:3, 3] = rng.normal(size=3) * 2
    return T


def fly(T, velocity, reference, limits, steps):
    """Follow `reference(k) -> (T, linear, angular)`; yield pose and twist after each step."""
    for k in range(steps):
        goal, linear_goal, angular_goal = reference(k + 1)
        linear, angular = follow(T, velocity, goal, linear_goal, angular_goal, DT, limits)
        T, velocity = integrate_twist(T, linear, angular, DT), linear
        yield T, linear, angular


def orbit(k, radius_m=1.1, rate_rps=0.4):
    """A camera on a circle that looks at its centre, and its exact twist."""
    angle = rate_rps * k * DT
    eye = np.array([radius_m * np.cos(angle), radius_m * np.sin(angle), 0.5])
    linear = rate_rps * np.array([-eye[1], eye[0], 0.0])
    return look_at(eye, (0, 0, 0.2)), linear, np.array([0.0, 0.0, rate_rps])


def orbit_turns(k, rate_rps=0.4):
    return k * DT * rate_rps / (2 * np.pi)


@pytest.mark.parametrize("seed", SEEDS)
def test_without_limits_the_camera_is_on_its_reference_at_the_next_tick(seed):
    rng = np.random.default_rng(seed)
    T, goal = random_pose(rng), random_pose(rng)
    linear, angular = follow(T, *rng.normal(size=(1, 3)), goal, *rng.normal(size=(2, 3)), DT,
                             UNLIMITED)  # fmt: skip
    metres, radians = pose_error(integrate_twist(T, linear, angular, DT), goal)
    assert metres < 1e-9
    assert radians < 1e-7


@pytest.mark.parametrize("seed", SEEDS)
def test_a_camera_at_rest_reaches_a_still_goal_from_anywhere_without_overshoot(seed):
    rng = np.random.default_rng(seed)
    T, goal = random_pose(rng), random_pose(rng)
    errors = [pose_error(T, goal)]
    errors += [pose_error(at, goal) for at, _, _ in fly(T, STILL, lambda _: (goal, STILL, STILL),
                                                        LIMITS, 120)]  # fmt: skip
    metres, radians = np.array(errors).T
    assert metres[-1] < 1e-9
    assert radians[-1] < 1e-7
    assert (np.diff(metres) <= 1e-9).all()
    assert (np.diff(radians) <= 1e-7).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_moving_camera_converges_on_a_moving_reference(seed):
    rng = np.random.default_rng(seed)
    path = list(fly(random_pose(rng), rng.normal(size=3), orbit, LIMITS, 150))
    metres, radians = pose_error(path[-1][0], orbit(150)[0])
    assert metres < 1e-9
    assert radians < 1e-7


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("gain", [0.3, 1.0])
def test_the_limits_are_never_exceeded(seed, gain):
    rng = np.random.default_rng(seed)
    limits = DriveLimits(max_speed_mps=0.7, max_turn_rps=1.1, max_acceleration_mps2=0.9, gain=gain)
    before = STILL

    def wild(_):
        return random_pose(rng), *rng.normal(size=(2, 3)) * 3

    for _, linear, angular in fly(random_pose(rng), before, wild, limits, 60):
        assert np.linalg.norm(linear) <= 0.7 + 1e-12
        assert np.linalg.norm(angular) <= 1.1 + 1e-12
        assert np.linalg.norm(linear - before) <= 0.9 * DT + 1e-12
        before = linear


def test_a_feasible_moving_reference_is_tracked_exactly():
    start, linear, _ = orbit(0)
    for k, (T, _, _) in enumerate(fly(start, linear, orbit, LIMITS, 300)):
        metres, radians = pose_error(T, orbit(k + 1)[0])
        assert metres < 1e-9
        assert radians < 1e-7


def test_a_smaller_gain_closes_that_share_of_the_error_per_tick():
    limits = UNLIMITED.model_copy(update={"gain": 0.25})
    goal, T = np.eye(4), np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_exp([0, 0.8, 0]), [1.0, 0, 0]
    linear, angular = follow(T, STILL, goal, STILL, STILL, DT, limits)
    metres, radians = pose_error(integrate_twist(T, linear, angular, DT), goal)
    assert metres == pytest.approx(0.75)
    assert radians == pytest.approx(0.6)


@pytest.mark.parametrize("angle", np.pi + np.array([-1e-3, -1e-7, -1e-12, 0.0, 1e-12, 1e-7, 1e-3]))
def test_a_half_turn_is_taken_at_full_rate_about_its_axis_and_arrives(angle):
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    goal = np.eye(4)
    goal[:3, :3] = rotation_exp(angle * axis)
    path = list(fly(np.eye(4), STILL, lambda _: (goal, STILL, STILL), LIMITS, 60))
    first = path[0][2]
    assert np.linalg.norm(first) == pytest.approx(LIMITS.max_turn_rps)
    assert abs(first @ axis) == pytest.approx(LIMITS.max_turn_rps, rel=1e-6)
    # It never changes its mind on the way: all turning is to the same side.
    assert all(first @ angular > -1e-6 for _, _, angular in path)
    assert pose_error(path[-1][0], goal)[1] < 1e-7


def test_tracking_does_not_notice_the_heading_wrapping_around():
    commands = np.array(
        [angular for _, _, angular in fly(orbit(0)[0], orbit(0)[1], orbit, LIMITS, 500)]
    )
    assert orbit_turns(500) > 2
    np.testing.assert_allclose(commands, np.tile([0, 0, 0.4], (500, 1)), atol=1e-7)
