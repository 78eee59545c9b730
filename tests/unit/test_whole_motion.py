"""Strategies that know the motion in advance: the article's numbers, and that they see it all."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.planner.bumps import bump_sum
from services.planner.errors import InfeasibleError, PlannerError
from services.planner.feasibility import check
from services.planner.known_motion import greatest_curvature, known_path
from services.planner.planar import robot_references
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.strategies.adaptive_angles import adaptive_angles
from services.planner.strategies.adaptive_scale import adaptive_scale, bump_waves, opened
from services.planner.strategies.constant_angles import constant_angles
from services.planner.whole_motion import (
    greatest_scale,
    nearest_of,
    plan_whole,
    slots_of,
)

pytestmark = pytest.mark.unit

BETA = np.radians(30)
SEEING = Limits(beta_rad=BETA)
ARTICLE = known_path("ellipse", (25.0, 12.6157), 200.0, 401)
WIDER = known_path("ellipse", (25.0, 12.7), 200.0, 401)  # kappa_max = 0.155.
STRATEGIES = ("circle", "adaptive_scale", "constant_angles", "adaptive_angles")
scenes = st.tuples(st.floats(1.0, 4.0), st.floats(0.6, 0.95), st.integers(2, 7))


def worst_deg(motion, slots):
    return np.degrees(max(r.bearing_rad for r in check(motion.target, slots, SEEING).robots))


def test_bumps_have_exact_derivatives():
    rng = np.random.default_rng(1)
    t, h = np.linspace(0, 10, 11), 1e-4
    args = (rng.uniform(0, 10, 5), rng.normal(size=5), 1.3)
    before, now, after = (bump_sum(t + s, *args) for s in (-h, 0, h))
    np.testing.assert_allclose(now[1:], ((after - before) / (2 * h))[:2], atol=1e-7)


def articles(*, wraps):
    """Strategy B of the article with its a and c, on the path with kappa_max = 0.155."""
    base = 0.5 / greatest_curvature(WIDER.target)
    waves = bump_waves(WIDER, base, SEEING, 2.0, wraps=wraps)
    return opened(base, 0.053 * waves, ring_angles(5))


def fastest(slots):
    return max(r.v_max_mps for r in check(WIDER.target, slots, SEEING).robots)


def test_the_articles_bumps_open_the_formation_as_the_article_says():
    slots = articles(wraps=False)
    assert slots.d_m.min() == pytest.approx(3.24, abs=5e-3)
    assert slots.d_m.max() == pytest.approx(4.20, abs=1e-2)
    assert worst_deg(WIDER, slots) == pytest.approx(29.99, abs=5e-3)
    assert fastest(slots) == pytest.approx(0.983, abs=5e-4)


def test_on_a_closed_lap_bumps_go_round_and_nobody_hurries_at_its_ends():
    slots = articles(wraps=True)
    assert slots.d_m.max() == pytest.approx(4.19, abs=1e-2)
    assert worst_deg(WIDER, slots) == pytest.approx(29.99, abs=5e-3)
    assert fastest(slots) == pytest.approx(0.849, abs=5e-4)  # The 0.983 are those of the seam.


@pytest.mark.parametrize("strategy", ["adaptive_scale", "adaptive_angles"])
def test_a_closed_lap_ends_as_it_began(strategy):
    slots = slots_of(strategy, ARTICLE, 3, 3.6 if strategy == "adaptive_angles" else 3.1, SEEING)
    told = (slots.d_m, slots.d_dot, slots.d_ddot, slots.theta_rad, slots.theta_dot)
    changing = [each for each in told if len(np.atleast_1d(each)) == len(ARTICLE.t_s)]
    assert len(changing) >= 2
    for each in changing:
        np.testing.assert_allclose(each[-1], each[0], atol=1e-12)


def test_the_search_opens_it_farther_than_the_article_does():
    base = 0.5 / greatest_curvature(WIDER.target)
    ours = adaptive_scale(WIDER, 5, base, SEEING)
    assert (1 / ours.d_m).sum() < (1 / articles(wraps=True).d_m).sum()
    assert ours.d_m.max() > 5.1
    assert check(WIDER.target, ours, SEEING).feasible
    assert worst_deg(WIDER, ours) > 29.9  # To the very limit.


def test_constant_angles_of_five_cameras_at_five_metres_are_the_articles():
    fine = known_path("ellipse", (25.0, 12.6157), 200.0, 20001)
    slots = constant_angles(fine, 5, 5.0, SEEING)
    expected = [-108, -36, 57.36, 102.29, 167.14]
    np.testing.assert_allclose(np.degrees(slots.theta_rad), expected, atol=5e-3)
    assert check(fine.target, slots, SEEING).feasible


def test_adaptive_angles_move_less_than_constant_ones_and_only_those_that_must():
    adaptive, constant = (f(ARTICLE, 5, 5.0, SEEING) for f in (adaptive_angles, constant_angles))
    assert check(ARTICLE.target, adaptive, SEEING).feasible
    moved = np.abs(adaptive.theta_rad - adaptive.theta_0_rad)
    away = np.abs(constant.theta_rad - constant.theta_0_rad)
    assert (moved.max(axis=0) > 0).tolist() == [False, False, True, True, True]
    assert (moved.mean(axis=0) <= away).all()


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_derivatives_of_the_slots_are_derivatives(strategy):
    fine = known_path("ellipse", (25.0, 12.6157), 200.0, 4001)
    slots = slots_of(strategy, fine, 3, 3.1 if strategy == "adaptive_scale" else 3.5, SEEING)
    step = fine.t_s[1] - fine.t_s[0]
    shape = (len(fine.t_s), 3)
    for value, rate in (
        (np.broadcast_to(np.atleast_1d(slots.d_m)[:, None], shape), np.atleast_1d(slots.d_dot)),
        (np.broadcast_to(np.atleast_1d(slots.d_dot)[:, None], shape), np.atleast_1d(slots.d_ddot)),
    ):
        slope = np.gradient(value[:, 0], step)[1:-1]
        np.testing.assert_allclose(slope, np.broadcast_to(rate, shape[:1])[1:-1], atol=1e-3)
    for value, rate in (
        (slots.theta_rad, slots.theta_dot),
        (slots.theta_dot, slots.theta_ddot),
    ):
        slope = np.gradient(np.broadcast_to(value, shape), step, axis=0)[1:-1]
        np.testing.assert_allclose(slope, np.broadcast_to(rate, shape)[1:-1], atol=1e-3)


@settings(max_examples=15, deadline=None)
@given(scenes, st.sampled_from(STRATEGIES))
def test_at_the_greatest_scale_every_strategy_sees_a_target_with_size(scene, strategy):
    a, ratio, num = scene
    motion = known_path("ellipse", (a, a * ratio), 40.0, 121)
    limits = replace(SEEING, target_radius_m=0.05 * a * ratio**2)
    d = greatest_scale(motion, limits)
    assert check(motion.target, slots_of(strategy, motion, num, d, limits), limits).feasible


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_flying_cameras_keep_the_even_circle(strategy):
    flying = replace(SEEING, drive="flying")
    slots = slots_of(strategy, ARTICLE, 6, 20.0, flying)
    np.testing.assert_array_equal(slots.theta_rad, ring_angles(6))
    assert slots.d_m == 20.0
    assert check(ARTICLE.target, slots, flying).feasible


def test_the_nearest_scale_is_feasible_and_the_next_is_not():
    nearest = nearest_of("circle", ARTICLE, 5, 5.0, SEEING)
    assert nearest == pytest.approx(3.201, abs=2e-3)
    assert plan_whole("circle", ARTICLE, 5, nearest, SEEING).refusal is None
    assert plan_whole("circle", ARTICLE, 5, nearest + 2e-3, SEEING).refusal
    nearest = nearest_of("constant_angles", ARTICLE, 5, 6.0, SEEING)
    assert plan_whole("constant_angles", ARTICLE, 5, nearest, SEEING).refusal is None
    with pytest.raises(InfeasibleError, match=f"nearest feasible d = {nearest:.3f} m"):
        plan_whole("constant_angles", ARTICLE, 5, nearest + 2e-3, SEEING)


def test_an_infeasible_wish_is_refused_with_the_inequality_and_what_would_do():
    plan = plan_whole("circle", ARTICLE, 5, 5.0, SEEING)
    assert re.fullmatch(
        r"circle, N = 5, d = 5 m: field of view: max \|beta_ri\| \+ beta_R <= beta is violated, "
        r"49\.\d+ > 30 deg; nearest feasible d = 3\.20\d m",
        plan.refusal,
    )
    assert not plan.report.feasible


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_where_nothing_is_feasible_the_refusal_says_so(strategy):
    few = known_path("ellipse", (25.0, 12.6157), 200.0, 61)
    hasty = replace(SEEING, v_max_mps=0.5)
    refusal = plan_whole(strategy, few, 3, 3.0, hasty).refusal
    assert "speed: max |v_ri| <= v_max is violated, 0.8" in refusal
    assert refusal.endswith("no d is feasible, the limit itself must give way")


def test_a_target_too_large_for_the_path_is_refused_with_the_greatest_that_is_not():
    tight = known_path("circle", (2.0, 2.0), 20.0, 33)  # kappa = 0.5.
    with pytest.raises(InfeasibleError, match=r"0\.25 > 0\.212 m; nearest feasible R = 0\.211 m"):
        greatest_scale(tight, Limits(np.radians(38), target_radius_m=0.25))
    assert greatest_scale(tight, Limits(np.radians(38), target_radius_m=0.211)) > 0


def test_on_a_line_any_scale_will_do():
    line = known_path("line", (2.0, 2.0), 20.0, 33)
    with pytest.raises(PlannerError, match="nothing bounds the scale"):
        greatest_scale(line, SEEING)
    for strategy in STRATEGIES:
        slots = slots_of(strategy, line, 4, 50.0, SEEING)
        refs = robot_references(line.target, slots)
        np.testing.assert_allclose(refs.bearing_rad, 0, atol=1e-12)


def test_constant_angles_that_do_not_exist_are_refused():
    assert issubclass(InfeasibleError, PlannerError)
    with pytest.raises(InfeasibleError, match="theta_0 = 36 deg: no angle sees the target"):
        constant_angles(ARTICLE, 5, 6.0, SEEING)
    with pytest.raises(InfeasibleError, match=r"throughout; nearest feasible d = 5\.\d+ m"):
        plan_whole("constant_angles", ARTICLE, 5, 6.0, SEEING)


def test_adaptive_angles_that_do_not_exist_are_refused():
    with pytest.raises(InfeasibleError, match="however it moves on the circle"):
        adaptive_angles(ARTICLE, 5, 7.0, SEEING)
