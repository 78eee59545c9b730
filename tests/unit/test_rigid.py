"""Laws of the rigid motions."""

import numpy as np
import pytest

from services.kernels.rigid import (
    apply,
    integrate_twist,
    inverse,
    look_at,
    optical_yaw,
    planar,
    pose_error,
    rotation_exp,
    rotation_log,
)

pytestmark = pytest.mark.unit
SEEDS = range(20)


def random_pose(rng):
    T = np.eye(4)
    T[:3, :3] = rotation_exp(rng.normal(size=3))
    T[:3, 3] = rng.normal(size=3)
    return T


@pytest.mark.parametrize("seed", SEEDS)
def test_a_motion_and_its_inverse_cancel(seed):
    rng = np.random.default_rng(seed)
    T, points = random_pose(rng), rng.normal(size=(7, 3))
    np.testing.assert_allclose(apply(inverse(T), apply(T, points)), points, atol=1e-12)
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 1.0, 3.0, np.pi - 1e-8, np.pi - 1e-14])
@pytest.mark.parametrize("seed", range(5))
def test_log_inverts_exp_at_every_angle_up_to_a_half_turn(seed, angle):
    axis = np.random.default_rng(seed).normal(size=3)
    w = angle * axis / np.linalg.norm(axis)
    np.testing.assert_allclose(
        rotation_log(rotation_exp(w)), w, atol=3e-8 if angle > 3.1 else 1e-12
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_exp_is_a_rotation_and_angles_about_one_axis_add(seed):
    w = np.random.default_rng(seed).normal(size=3)
    R = rotation_exp(w)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_exp(0.3 * w) @ rotation_exp(0.7 * w), R, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_camera_that_looks_at_a_point_sees_it_ahead_and_upright(seed):
    rng = np.random.default_rng(seed)
    eye, target = rng.normal(size=(2, 3))
    T = look_at(eye, target)
    np.testing.assert_allclose(
        apply(inverse(T), target), [0, 0, np.linalg.norm(target - eye)], atol=1e-12
    )
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert T[2, 0] == pytest.approx(0.0)  # the image's right is level.
    assert T[2, 1] < 0.0  # the image's down points down.


@pytest.mark.parametrize("height", [-1.0, 1.0])
@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-10])
def test_straight_up_and_down_is_the_limit_of_the_view_from_behind(height, offset):
    T = look_at([-offset, 0.0, height], [0.0, 0.0, 0.0])
    near = look_at([-1e-6, 0.0, height], [0.0, 0.0, 0.0])
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert pose_error(T, near)[1] < 2e-6


def test_a_camera_at_its_target_or_without_an_up_is_refused():
    with pytest.raises(ValueError, match="apart"):
        look_at([1, 2, 3], [1, 2, 3])
    with pytest.raises(ValueError, match="apart"):
        look_at([np.nan, 2, 3], [1, 2, 3])
    with pytest.raises(ValueError, match="up"):
        look_at([0, 0, 0], [1, 0, 0], up=(0, 0, 0))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_constant_twist_integrates_the_same_in_one_step_or_in_many(seed):
    rng = np.random.default_rng(seed)
    T, linear, angular = random_pose(rng), rng.normal(size=3), rng.normal(size=3)
    once, stepped = integrate_twist(T, linear, angular, 0.5), T
    for _ in range(10):
        stepped = integrate_twist(stepped, linear, angular, 0.05)
    np.testing.assert_allclose(stepped, once, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_pose_error_measures_the_twist_that_joins_two_poses(seed):
    rng = np.random.default_rng(seed)
    T, linear, angular = random_pose(rng), rng.normal(size=3), rng.normal(size=3) * 0.5
    metres, radians = pose_error(T, integrate_twist(T, linear, angular, 1.0))
    assert metres == pytest.approx(np.linalg.norm(linear))
    assert radians == pytest.approx(np.linalg.norm(angular))


def test_planar_puts_x_forward_along_the_heading():
    T = planar(1.0, 2.0, np.pi / 2)
    np.testing.assert_allclose(apply(T, [1.0, 0.0, 0.5]), [1.0, 3.0, 0.5], atol=1e-12)


@pytest.mark.parametrize("yaw", np.linspace(-3.1, 3.1, 9))
@pytest.mark.parametrize("tilt", [-1.4, -0.3, 0.0, 1.4])
def test_an_upright_camera_looks_along_its_yaw_however_far_it_is_tilted(yaw, tilt):
    T = look_at([1.0, 2.0, 3.0], [1 + np.cos(yaw), 2 + np.sin(yaw), 3 + np.tan(tilt)])
    assert optical_yaw(T) == pytest.approx(yaw)
