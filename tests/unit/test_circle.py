"""The circle: a regular polygon that the target carries, with its exact velocities."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.kernels.rigid import apply, inverse, planar, rotation_log
from services.planner.motion import Motion
from services.planner.ring import ring_angles
from services.planner.strategies.circle import Circle, CircleSettings

pytestmark = pytest.mark.unit

STEP_S = 1e-4  # Central differences of a smooth motion: error ~ step^2 = 1e-8.


def circle(cameras=6, radius_m=1.1, elevation_deg=20.0, centre_height_m=0.2):
    return Circle(
        CircleSettings(
            cameras=cameras,
            radius_m=radius_m,
            elevation_rad=math.radians(elevation_deg),
            centre_height_m=centre_height_m,
        )
    )


def unicycle(seed):
    """Return t -> Motion of a random smooth unicycle: heading and path are sums of sines."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(0.2, 1.0, (3, 2))
    phase = rng.uniform(0, 2 * np.pi, 3)

    def motion(t):
        heading = a[0] * np.sin(a[1] * t + phase[0]) + 0.3 * t
        turn = a[0] * a[1] * np.cos(a[1] * t + phase[0]) + 0.3
        x, y = b[0] * np.sin(b[1] * t + phase[1]), c[0] * np.cos(c[1] * t + phase[2])
        vx = b[0] * b[1] * np.cos(b[1] * t + phase[1])
        vy = -c[0] * c[1] * np.sin(c[1] * t + phase[2])
        return Motion(planar(x, y, heading), np.array([vx, vy, 0]), np.array([0, 0, turn]))

    return motion


shapes = st.tuples(
    st.integers(1, 64), st.floats(0.3, 5.0), st.floats(-5.0, 85.0), st.floats(0.5, 1.0)
)


@given(shapes, st.integers(0, 2**32 - 1), st.floats(0, 20))
def test_velocities_are_the_derivatives_of_the_poses(shape, seed, t):
    strategy, target = circle(*shape), unicycle(seed)
    now = strategy.plan(target(t), t).views
    before = strategy.plan(target(t - STEP_S), t - STEP_S).views
    after = strategy.plan(target(t + STEP_S), t + STEP_S).views
    for a, b, c in zip(before, now, after, strict=True):
        linear = (c.T[:3, 3] - a.T[:3, 3]) / (2 * STEP_S)
        angular = rotation_log(c.T[:3, :3] @ a.T[:3, :3].T) / (2 * STEP_S)
        np.testing.assert_allclose(b.linear, linear, atol=1e-6)
        np.testing.assert_allclose(b.angular, angular, atol=1e-6)


@given(shapes, st.integers(0, 2**32 - 1), st.floats(0, 20))
def test_every_camera_looks_at_the_centre_from_the_radius(shape, seed, t):
    plan = circle(*shape).plan(unicycle(seed)(t), t)
    assert len(plan.views) == shape[0]
    for view in plan.views:
        np.testing.assert_allclose(
            apply(inverse(view.T), plan.centre_m), [0, 0, shape[1]], atol=1e-9
        )
        assert view.T[2, 0] == pytest.approx(0, abs=1e-12)  # The image is level ...
        assert view.T[2, 1] <= 0  # ... and not upside down.


@given(shapes, st.integers(0, 2**32 - 1))
def test_the_polygon_is_regular(shape, seed):
    corners = np.array(circle(*shape).plan(unicycle(seed)(1.0), 1.0).polygon_m)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    expected = 2 * shape[1] * math.cos(math.radians(shape[2])) * math.sin(math.pi / shape[0])
    np.testing.assert_allclose(sides, expected, atol=1e-9)


@pytest.mark.parametrize("num", [1, 2, 3, 5, 6, 64])
def test_angles_end_straight_ahead_of_the_target_and_are_even(num):
    angles = ring_angles(num)
    assert angles[-1] == pytest.approx(math.pi)
    np.testing.assert_allclose(np.diff(angles), 2 * math.pi / num)


def test_angles_of_five_are_those_of_the_paper():
    np.testing.assert_allclose(np.degrees(ring_angles(5)), [-108, -36, 36, 108, 180])


def test_the_formation_turns_with_the_target():
    ahead = circle().plan(Motion(np.eye(4), np.zeros(3), np.zeros(3)), 0)
    turned = circle().plan(Motion(planar(3, 2, 1.0), np.zeros(3), np.zeros(3)), 0)
    for a, b in zip(ahead.views, turned.views, strict=True):
        np.testing.assert_allclose(b.T, planar(3, 2, 1.0) @ a.T, atol=1e-12)
