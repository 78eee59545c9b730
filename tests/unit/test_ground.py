"""The analytic ground against its equation."""

import numpy as np
import pytest

from services.kernels.ground import fill_ground
from services.kernels.rigid import apply, look_at, rotation_exp

pytestmark = pytest.mark.unit

WIDTH, HEIGHT = 160, 120
INTRINSICS = np.array([150.0, 140.0, 79.5, 59.5])


def ground(T, near_m=0.01, max_range_m=5.0):
    depth = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    fill_ground(T, INTRINSICS, near_m, max_range_m, depth)
    return depth


def rays():
    fx, fy, cx, cy = INTRINSICS
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([(u - cx) / fx, (v - cy) / fy, np.ones((HEIGHT, WIDTH))], axis=-1)


def random_pose(seed):
    rng = np.random.default_rng(seed)
    T = look_at([*rng.normal(size=2), rng.uniform(0.1, 2.0)], rng.normal(size=3) * [1, 1, 0.2])
    T[:3, :3] = T[:3, :3] @ rotation_exp([0, 0, rng.uniform(-1, 1)])
    return T


@pytest.mark.parametrize("seed", range(10))
def test_every_pixel_that_sees_the_ground_lifts_to_z_zero(seed):
    T = random_pose(seed)
    depth = ground(T)
    seen = np.isfinite(depth)
    assert seen.any()
    points = apply(T, rays()[seen] * depth[seen][:, None])
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-5)


@pytest.mark.parametrize("seed", range(10))
def test_a_pixel_sees_the_ground_iff_its_ray_meets_it_in_range(seed):
    T = random_pose(seed)
    slope = rays() @ T[2, :3]
    with np.errstate(divide="ignore"):
        depth = -T[2, 3] / slope
    clear = np.abs(depth - 5.0) > 1e-6
    expected = (depth >= 0.01) & (depth <= 5.0)
    np.testing.assert_array_equal(np.isfinite(ground(T))[clear], expected[clear])


def test_the_sky_is_infinitely_far_and_nothing_is_left_unset():
    up = look_at((0.0, 0.0, 1.0), (0.1, 0.0, 5.0))
    assert np.isposinf(ground(up)).all()


def test_a_camera_in_the_plane_itself_sees_no_ground():
    assert np.isposinf(ground(look_at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))).all()
