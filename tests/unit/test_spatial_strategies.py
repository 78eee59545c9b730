"""Rings, sphere, orbit, random: laws that hold for each, and what each is for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.kernels.rigid import apply, inverse, planar, pose_error, rotation_log
from services.planner.errors import PlannerError
from services.planner.formation import FormationSettings
from services.planner.motion import Motion, stacked, still
from services.planner.spherical import Spherical
from services.planner.strategies.open import open_strategy
from services.planner.strategies.rings import shared
from services.planner.strategies.sphere import spread

pytestmark = pytest.mark.unit

STEP_S = 1e-4  # Central differences of a smooth motion: error ~ step^2 = 1e-8.
SPATIAL = ("circle", "rings", "sphere", "orbit", "random")


def opened(strategy, **changes):
    return open_strategy(FormationSettings(strategy=strategy, **changes).strategy_settings())


def target_at(t):
    """A unicycle on a circle of 1.5 m whose speed changes."""
    phase, rate = 0.3 * t + 0.2 * np.sin(0.5 * t), 0.3 + 0.1 * np.cos(0.5 * t)
    T = planar(1.5 * np.cos(phase), 1.5 * np.sin(phase), phase + np.pi / 2)
    return Motion(T, T[:3, :3] @ [1.5 * rate, 0, 0], np.array([0, 0, rate]))


formations = st.builds(
    dict,
    strategy=st.sampled_from(SPATIAL),
    cameras=st.integers(1, 64),
    radius_m=st.floats(0.4, 4.0),
    elevation_deg=st.floats(0, 40),
    top_elevation_deg=st.floats(40, 85),
    rings=st.integers(1, 6),
    orbit_deg_s=st.floats(-90, 90),
    seed=st.integers(0, 2**32 - 1),
)


@settings(max_examples=60)
@given(formations, st.floats(0.01, 40))
def test_velocities_are_the_derivatives_of_the_poses(formation, t):
    strategy = opened(**formation)
    a, now, b = (
        stacked(strategy.plan(target_at(t + shift), t + shift).views)
        for shift in (-STEP_S, 0, STEP_S)
    )
    linear = (b.T[:, :3, 3] - a.T[:, :3, 3]) / (2 * STEP_S)
    turns = b.T[:, :3, :3] @ a.T[:, :3, :3].transpose(0, 2, 1)
    angular = np.array([rotation_log(turn) for turn in turns]) / (2 * STEP_S)
    np.testing.assert_allclose(now.linear, linear, atol=1e-6)
    np.testing.assert_allclose(now.angular, angular, atol=1e-6)


@settings(max_examples=60)
@given(formations, st.floats(0, 40))
def test_every_camera_sees_the_centre_on_its_axis_from_the_radius_and_upright(formation, t):
    plan = opened(**formation).plan(target_at(t), t)
    assert len(plan.views) == formation["cameras"]
    for view in plan.views:
        centre = apply(inverse(view.T), plan.centre_m)
        np.testing.assert_allclose(centre, [0, 0, formation["radius_m"]], atol=1e-9)
        assert view.T[2, 0] == pytest.approx(0, abs=1e-12)
        assert view.T[2, 1] <= 1e-12
        assert np.linalg.det(view.T[:3, :3]) == pytest.approx(1)


@settings(max_examples=60)
@given(formations, st.floats(0, 40))
def test_no_camera_leaves_its_elevations(formation, t):
    local = stacked(opened(**formation).plan(still(np.eye(4)), t).views)
    elevation = Spherical.of(local, np.array([0, 0, 0.2])).elevation_rad
    low = np.radians(formation["elevation_deg"])
    bands = formation["strategy"] in ("rings", "sphere", "random")
    high = np.radians(formation["top_elevation_deg"]) if bands else low
    assert np.all((elevation > low - 1e-9) & (elevation < high + 1e-9))


@pytest.mark.parametrize("strategy", SPATIAL)
def test_the_same_settings_give_the_same_views(strategy):
    a, b = (opened(strategy, seed=5).plan(target_at(7.0), 7.0).views for _ in range(2))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.T, other.T)


@pytest.mark.parametrize(
    ("num", "weights", "counts"),
    [(6, [1, 1], [3, 3]), (7, [1, 0.5], [5, 2]), (3, [1, 1, 1e-9], [1, 1, 1]), (1, [1], [1])],
)
def test_rings_share_the_cameras_by_circumference_and_none_is_empty(num, weights, counts):
    assert shared(num, np.array(weights)) == counts


def ring_places(**changes):
    local = stacked(opened("rings", elevation_deg=0, **changes).plan(still(np.eye(4)), 0.0).views)
    places = Spherical.of(local, np.array([0, 0, 0.2]))
    return np.round(np.degrees(places.elevation_rad)), places.theta_rad


def test_rings_lie_evenly_between_their_elevations():
    elevation_deg, _ = ring_places(cameras=9, rings=3, top_elevation_deg=60)
    assert sorted(set(elevation_deg)) == [0, 30, 60]


def test_every_other_ring_looks_between_the_cameras_of_the_first():
    elevation_deg, theta = ring_places(cameras=8, rings=2, top_elevation_deg=20)
    low, high = (np.exp(1j * theta[elevation_deg == level]) for level in (0, 20))
    assert len(low) == len(high) == 4
    apart = np.abs(low[:, None] - high[None]).min(axis=0)
    np.testing.assert_allclose(apart, 2 * np.sin(np.pi / 8))


@pytest.mark.parametrize(("num", "least"), [(2, 2.0), (4, 1.633), (6, 1.414), (12, 1.051)])
def test_over_the_whole_sphere_the_spread_is_that_of_the_regular_solids(num, least):
    points = spread(num, -np.pi / 2, np.pi / 2)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2) + 3 * np.eye(num)
    assert apart.min() == pytest.approx(least, rel=0.02)


@pytest.mark.parametrize("num", [2, 7, 24, 64])
def test_on_a_cap_the_spread_is_near_the_densest_packing(num):
    low, high = np.radians([20, 85])
    points = spread(num, low, high)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2) + 3 * np.eye(num)
    area = 2 * np.pi * (np.sin(high) - np.sin(low))
    hexagonal = np.sqrt(2 / np.sqrt(3) * area / num)
    assert apart.min() > 0.75 * min(hexagonal, 1.8)


def test_an_orbit_turns_at_its_rate():
    strategy = opened("orbit", orbit_deg_s=30.0)
    start, later = (strategy.plan(still(np.eye(4)), t).views for t in (0.0, 2.0))
    # 60 degrees: every camera of six has taken the place of the next.
    for index, view in enumerate(later):
        assert pose_error(view.T, start[(index + 1) % 6].T) == pytest.approx((0, 0), abs=1e-9)


def test_random_views_rest_at_each_draw_and_other_seeds_draw_others():
    strategy, other = opened("random", seed=1, redraw_s=4.0), opened("random", seed=2)
    for t in (0.0, 4.0, 8.0):
        assert not np.any(stacked(strategy.plan(still(np.eye(4)), t).views).linear)
    one = stacked(strategy.plan(still(np.eye(4)), 0.0).views).T
    assert np.abs(stacked(strategy.plan(still(np.eye(4)), 4.0).views).T - one).max() > 0.1
    assert np.abs(stacked(other.plan(still(np.eye(4)), 0.0).views).T - one).max() > 0.1


def test_random_flights_keep_the_order_around_the_target():
    strategy = opened("random", cameras=12, redraw_s=1.0)
    for t in np.linspace(0, 10, 101):
        local = stacked(strategy.plan(still(np.eye(4)), float(t)).views)
        theta = Spherical.of(local, np.array([0, 0, 0.2])).theta_rad
        assert np.all(np.diff(theta) > 0)


def test_a_top_below_the_bottom_is_refused():
    with pytest.raises(PlannerError, match="top_elevation_deg 10 is below elevation_deg 20"):
        FormationSettings().changed({"strategy": "sphere", "top_elevation_deg": 10})
    assert FormationSettings(strategy="circle", top_elevation_deg=10)


@given(st.integers(0, 2**32 - 1))
def test_what_is_seen_from_a_frame_is_carried_back_by_it(seed):
    rng = np.random.default_rng(seed)
    frame = target_at(rng.uniform(0, 20))
    views = stacked(
        [Motion(target_at(t).T, *rng.normal(size=(2, 3))) for t in rng.uniform(0, 20, 5)]
    )
    again = frame.carry(views.seen_from(frame))
    for name in ("T", "linear", "angular"):
        np.testing.assert_allclose(getattr(again, name), getattr(views, name), atol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_a_place_and_its_rates_come_back_from_the_view(seed):
    rng = np.random.default_rng(seed)
    parts = [rng.uniform(0.3, 3, 4), rng.uniform(-3, 3, 4), rng.uniform(-1.4, 1.4, 4)]
    places = Spherical(*parts, *rng.normal(size=(3, 4)))
    centre = rng.normal(size=3)
    again = Spherical.of(places.gazing(centre), centre)
    for name in vars(places):
        np.testing.assert_allclose(getattr(again, name), getattr(places, name), atol=1e-9)
