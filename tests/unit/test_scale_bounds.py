"""Closed bounds of scale and angles against the article's numbers and against the bearings."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from services.planner.known_motion import curvature, greatest_curvature, known_path
from services.planner.planar import PlanarMotion, Slots, robot_references
from services.planner.ring import ring_angles
from services.planner.scale_bounds import (
    angle_bounds,
    critical_scale,
    edge_bearing,
    finite_set_scale,
    greatest_target_radius,
    scale_range,
    separation_scale,
)

pytestmark = pytest.mark.unit

BETA = np.radians(30)
KAPPA = np.pi / 20
ARTICLE = known_path("ellipse", (25.0, 12.6157), 200.0, 20001)


def test_the_articles_ellipse_has_the_articles_curvature_and_speeds():
    target = ARTICLE.target
    assert greatest_curvature(target) == pytest.approx(KAPPA, abs=5e-6)
    assert (target.v_mps.min(), target.v_mps.max()) == pytest.approx((0.396, 0.785), abs=5e-4)
    turns = np.degrees(np.abs(target.omega_rps))
    assert (turns.min(), turns.max()) == pytest.approx((0.91, 3.57), abs=5e-3)


def test_the_critical_scale_is_the_articles():
    assert 1 / critical_scale(BETA, KAPPA) == pytest.approx(0.3142, abs=5e-5)
    assert critical_scale(BETA, KAPPA) == pytest.approx(3.183, abs=5e-4)
    assert critical_scale(BETA, 0.0) == np.inf


@pytest.mark.parametrize(("num", "scale"), [(5, 3.201), (6, 3.676)])
def test_few_angles_allow_a_greater_scale(num, scale):
    assert finite_set_scale(BETA, KAPPA, ring_angles(num)) == pytest.approx(scale, abs=5e-4)


def test_angles_at_prescribed_scale_are_the_articles():
    lower, upper = angle_bounds(5.0, curvature(ARTICLE.target), BETA, ring_angles(5))
    chosen = np.degrees(np.clip(ring_angles(5), lower, upper))
    np.testing.assert_allclose(chosen, [-108, -36, 57.36, 102.29, 167.14], atol=5e-3)


def test_a_target_of_some_size_leaves_an_interval_of_scales():
    assert greatest_target_radius(BETA, KAPPA) == pytest.approx(0.4265, abs=5e-5)  # R <= 0.43.
    # 0.77 was found on a grid and rounded up; the closed form tells 0.7646.
    assert scale_range(BETA, KAPPA, 0.3) == pytest.approx((0.77, 2.50), abs=6e-3)
    scene = np.radians(40 - 2)
    least, greatest = scale_range(scene, 0.39, 0.20)
    assert least == pytest.approx(0.42, abs=5e-3)
    assert greatest == pytest.approx(1.2, abs=5e-2)
    assert scale_range(scene, 0.5, 0.20) == pytest.approx((0.50, 0.80), abs=5e-3)
    assert scale_range(scene, 0.5, 0.25) is None
    assert scale_range(scene, 0.0, 0.25) == (pytest.approx(0.25 / np.sin(scene)), np.inf)


angles = st.floats(0.1, 1.4)
bends = st.floats(0.01, 5.0)


@given(angles, bends, st.floats(0.001, 3.0))
def test_the_interval_of_scales_is_where_the_two_arcs_fit(beta, kappa, radius):
    def excess(d):
        return np.arcsin(min(d * kappa, 1.0)) + float(edge_bearing(radius, d)) - beta

    tightest = np.sqrt(radius / kappa)
    assume(abs(excess(tightest)) > 1e-6)
    found = scale_range(beta, kappa, radius)
    assert (found is not None) == (excess(tightest) < 0)
    assert (found is not None) == (radius <= greatest_target_radius(beta, kappa))
    if found:
        least, greatest = found
        assert excess(least) == pytest.approx(0, abs=1e-7)
        assert excess(greatest) == pytest.approx(0, abs=1e-7)
        assert least <= tightest <= greatest


@given(angles, bends, st.integers(1, 12), st.sampled_from([1, -1]))
def test_up_to_the_finite_set_scale_all_see_and_beyond_it_one_does_not(beta, kappa, num, side):
    """With turns to both sides, the bound is sharp; d_c is below it."""
    theta = ring_angles(num)
    scale = finite_set_scale(beta, kappa, theta)
    assert critical_scale(beta, kappa) <= scale * (1 + 1e-12)
    both = PlanarMotion(0.0, 0.0, 0.0, np.ones(2), kappa * np.array([1.0, -1.0]) * side)

    def worst(d):
        return np.abs(robot_references(both, Slots(d, theta)).bearing_rad).max()

    assert worst(scale * (1 - 1e-6)) <= beta
    assert worst(scale * (1 + 1e-6)) >= beta


@given(st.floats(0.2, 1.2), st.floats(0.1, 0.9), st.integers(1, 9), st.integers(0, 99))
def test_between_the_angle_bounds_a_robot_sees_and_outside_it_does_not(beta, tight, num, seed):
    kappa = tight * np.random.default_rng(seed).uniform(-1, 1, 50)
    theta_0 = ring_angles(num)
    lower, upper = angle_bounds(1.0, kappa, beta, theta_0)
    path = PlanarMotion(0.0, 0.0, 0.0, np.ones(50), kappa)
    assert (lower <= upper).any() or tight > np.sin(beta)

    def bearings(theta):
        return robot_references(path, Slots(1.0, theta, nominal_rad=theta_0)).bearing_rad

    between = np.abs(bearings((lower + upper) / 2)).max(axis=0)
    outside = np.abs(bearings(lower - 1e-6)).max(axis=0)
    open_ones = lower <= upper
    assert (between[open_ones] <= beta + 1e-9).all()
    assert (outside >= beta - 1e-9).all()


def test_no_angle_will_do_when_the_pivot_is_inside_the_formation():
    lower, upper = angle_bounds(5.0, np.array([0.5]), 0.1, np.array([0.0, np.pi / 2]))
    assert np.isnan([lower[0], upper[0]]).all()
    assert np.isfinite([lower[1], upper[1]]).all()


@pytest.mark.parametrize("num", [2, 3, 6, 64])
def test_a_regular_polygon_is_as_wide_as_its_corners_need(num):
    expected = 0.3 / (2 * np.sin(np.pi / num))
    assert separation_scale(0.3, ring_angles(num)) == pytest.approx(expected)
    assert separation_scale(0.3, ring_angles(1)) == 0.0
    assert separation_scale(0.3, np.array([1.0, 1.0])) == np.inf
    assert separation_scale(0.0, np.array([1.0, 1.0])) == 0.0
