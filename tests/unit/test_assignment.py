"""Cameras to places: the least travel, and ways that keep clear of each other and the target."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from services.kernels.detour import intrusion
from services.planner.assignment import assign, travel
from services.planner.course import Course
from services.planner.detours import bump, detours
from services.planner.planar import wrapped
from services.planner.spherical import Spherical, resting

pytestmark = pytest.mark.unit

SAFE_M = 0.2
seeds = st.integers(0, 2**32 - 1)


def random_places(rng, num, spacing=0.0):
    """Draw places above the ground, one by one, so far apart where that can be had."""
    kept = np.empty((0, 3))
    for _ in range(200 * num):
        place = np.array([rng.uniform(0.5, 2.0), rng.uniform(-np.pi, np.pi), rng.uniform(0, 1.4)])
        arms = course(np.vstack([kept, place]).T).arms_m()
        if np.all(np.linalg.norm(arms[:-1] - arms[-1], axis=1) > spacing):
            kept = np.vstack([kept, place])
        if len(kept) == num:
            break
    assert len(kept) == num
    return course(kept.T)


def course(parts):
    return Course.of(resting(*np.array(parts)))


def straight(start, end, shares):
    turn = wrapped(end.theta_rad - start.theta_rad)
    return start.towards(end, turn, shares[:, None])


def flown(start, end, out_m, shares):
    way = straight(start, end, shares)
    return Course(way.range_m + bump(shares)[:, None] * out_m, way.theta_rad, way.climb_m).arms_m()


def detours_of(start, end):
    shares = np.linspace(0, 1, 49)
    return detours(straight(start, end, shares), shares, SAFE_M)


def nearest(start, end, out_m):
    arms = flown(start, end, out_m, np.linspace(0, 1, 401))
    apart = np.linalg.norm(arms[:, :, None] - arms[:, None], axis=-1)
    return apart[:, *np.triu_indices(arms.shape[1], 1)].min(axis=0)


@given(seeds, st.integers(1, 40))
def test_the_assignment_is_as_cheap_as_scipys(seed, num):
    costs = np.random.default_rng(seed).normal(size=(num, num)) ** 3
    columns = assign(costs)
    assert sorted(columns) == list(range(num))
    rows, best = linear_sum_assignment(costs)
    assert costs[np.arange(num), columns].sum() == pytest.approx(costs[rows, best].sum())


def test_equal_costs_still_give_each_its_own():
    assert sorted(assign(np.zeros((64, 64)))) == list(range(64))


@given(seeds, st.integers(1, 6), st.integers(0, 2))
def test_with_places_to_spare_the_cheapest_are_taken(seed, num, spare):
    costs = np.random.default_rng(seed).normal(size=(num, num + spare))
    columns = assign(costs)
    assert len(set(columns)) == num
    rows, best = linear_sum_assignment(costs)
    assert costs[np.arange(num), columns].sum() == pytest.approx(costs[rows, best].sum())


@given(seeds, st.integers(2, 24))
def test_whoever_is_in_a_place_already_stays(seed, num):
    places = random_places(np.random.default_rng(seed), num)
    np.testing.assert_array_equal(assign(travel(places, places)), np.arange(num))


@settings(max_examples=60)
@given(seeds, st.integers(2, 16))
@example(3808286, 14)  # Drawn once, and too near then.
@example(1610752182, 14)
@example(1281475143, 16)
def test_on_the_way_no_pair_comes_nearer_than_is_safe_where_start_and_end_are_safe(seed, num):
    rng = np.random.default_rng(seed)
    start, end = random_places(rng, num, SAFE_M), random_places(rng, num, SAFE_M)
    columns = assign(travel(start, end))
    end = Course(end.range_m[columns], end.theta_rad[columns], end.climb_m[columns])
    out_m = detours_of(start, end)
    assert nearest(start, end, out_m).min() > 0.98 * SAFE_M


@settings(max_examples=60)
@given(seeds, st.integers(1, 16), st.floats(0, 1))
def test_on_the_way_nobody_comes_nearer_to_the_target_or_to_the_ground(seed, num, share):
    rng = np.random.default_rng(seed)
    height_m, ends = 0.3, []
    for _ in range(2):
        low = rng.uniform(-1, 1.4, num)
        far = rng.uniform(0.3, 3.0, num)
        low = np.maximum(low, np.arcsin(np.maximum(-1, -height_m / far)))  # Above the ground.
        ends.append(course([far, rng.uniform(-np.pi, np.pi, num), low]))
    start, end = ends
    (arms,) = flown(start, end, rng.uniform(0, 1, num), np.array([share]))
    nearest_m = np.minimum(start.range_m, end.range_m)
    assert np.all(np.linalg.norm(arms, axis=1) >= nearest_m - 1e-9)
    assert np.all(arms[:, 2] >= -height_m - 1e-9)


def test_cameras_that_would_meet_fly_around_each_other():
    start = course([[1.0, 1.0], [0.0, 0.4], [0.3, 0.3]])
    end = course([[1.0, 1.0], [0.4, 0.0], [0.3, 0.3]])
    assert nearest(start, end, np.zeros(2)).min() < 0.01
    out_m = detours_of(start, end)
    assert nearest(start, end, out_m).min() > 0.99 * SAFE_M
    assert np.count_nonzero(out_m) == 1


@given(seeds)
def test_coordinates_and_their_rates_come_back(seed):
    rng = np.random.default_rng(seed)
    parts = [rng.uniform(0.3, 3, 6), rng.uniform(-3, 3, 6), rng.uniform(-1.4, 1.4, 6)]
    places = Spherical(*parts, *rng.normal(size=(3, 6)))
    again = Course.of(places).places(Course.rates_of(places))
    for name in vars(places):
        np.testing.assert_allclose(getattr(again, name), getattr(places, name), atol=1e-9)


@given(st.floats(-100, 100))
def test_a_wrapped_angle_is_the_same_direction_in_one_turn(angle):
    turned = wrapped(np.array([angle]))
    assert -np.pi < turned[0] <= np.pi
    assert np.exp(1j * turned[0]) == pytest.approx(np.exp(1j * angle))


@given(seeds)
def test_an_intrusion_is_what_many_samples_of_straight_ways_find(seed):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(2, 9, 3)).cumsum(axis=1)
    step = sum(np.linalg.norm(np.diff(way, axis=0), axis=1).max() for way in (one, other))
    at = np.linspace(0, 8, 4001)
    ways = [
        np.stack([np.interp(at, np.arange(9), way[:, k]) for k in range(3)]) for way in (one, other)
    ]
    least = np.linalg.norm(ways[0] - ways[1], axis=0).min()
    for allowed in (0.5 * least, least + 0.3):
        expected = max(0.0, allowed - least)
        assert intrusion(one, other, step, allowed) == pytest.approx(expected, abs=2e-3)
