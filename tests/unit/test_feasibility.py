"""The report on a formation: the article's numbers, and that every rule can be broken."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.planner.feasibility import check
from services.planner.known_motion import curvature, known_path
from services.planner.nearest_scale import nearest_scale
from services.planner.planar import PlanarMotion, Slots, robot_references
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.scale_bounds import angle_bounds, critical_scale

pytestmark = pytest.mark.unit

BETA = np.radians(30)
SEEING = Limits(beta_rad=BETA)
ARTICLE = known_path("ellipse", (25.0, 12.6157), 200.0, 4001).target


def circle(num, d_m):
    return Slots(d_m, ring_angles(num))


def broken(report):
    return [rule.name for rule in report.rules if not rule.holds]


@pytest.mark.parametrize(
    ("num", "bearing", "slowest", "fastest", "turning"),
    [(5, 29.81, 0.217, 0.834, 4.59), (6, 26.57, 0.246, 0.829, 4.55)],
)
def test_at_the_critical_scale_the_article_is_feasible(num, bearing, slowest, fastest, turning):
    report = check(ARTICLE, circle(num, critical_scale(BETA, np.pi / 20)), SEEING)
    robots = report.robots
    assert report.feasible
    # arctan(1/2) = 26.5651 degrees, printed as 26.57.
    assert np.degrees(max(r.bearing_rad for r in robots)) == pytest.approx(bearing, abs=6e-3)
    assert min(r.v_min_mps for r in robots) == pytest.approx(slowest, abs=5e-4)
    assert max(r.v_max_mps for r in robots) == pytest.approx(fastest, abs=5e-4)
    assert np.degrees(max(r.omega_rps for r in robots)) == pytest.approx(turning, abs=5e-3)
    assert report.kappa_max_1pm == pytest.approx(np.pi / 20, abs=5e-6)
    assert report.critical_scale_m == pytest.approx(3.183, abs=5e-4)
    assert all(r.share_in_view == 1 for r in robots)


@pytest.mark.parametrize(("num", "bearing", "share"), [(5, 49.7, 77.7), (6, 50.8, 82.0)])
def test_at_five_metres_some_lose_the_target(num, bearing, share):
    fine = known_path("ellipse", (25.0, 12.6157), 200.0, 20001).target
    report = check(fine, circle(num, 5.0), SEEING)
    assert broken(report) == ["field of view"]
    assert np.degrees(max(r.bearing_rad for r in report.robots)) == pytest.approx(bearing, abs=0.05)
    assert 100 * min(r.share_in_view for r in report.robots) == pytest.approx(share, abs=0.05)


def test_of_five_cameras_at_five_metres_two_see_it_always():
    robots = check(ARTICLE, circle(5, 5.0), SEEING).robots
    always = [round(np.degrees(r.theta_rad)) for r in robots if r.share_in_view == 1]
    assert always == [-108, -36]
    assert [r.margin_rad >= 0 for r in robots] == [True, True, False, False, False]


def test_chosen_angles_are_feasible_where_even_ones_are_not():
    lower, upper = angle_bounds(5.0, curvature(ARTICLE), BETA, ring_angles(5))
    slots = Slots(5.0, np.clip(ring_angles(5), lower, upper), nominal_rad=ring_angles(5))
    assert check(ARTICLE, slots, SEEING).feasible


@given(st.floats(0.05, 1.4), st.floats(-2, 2), st.floats(0.1, 2), st.integers(1, 9))
def test_up_to_the_critical_scale_every_turn_is_feasible(beta, omega, v, num):
    d = min(critical_scale(beta, abs(omega) / v), 100.0)
    report = check(PlanarMotion(0, 0, 0, v, omega), circle(num, d), Limits(beta_rad=beta))
    assert report.feasible
    swing = np.sin(beta) * (1 + 1e-9)
    assert min(r.v_min_mps for r in report.robots) >= v * (1 - swing)
    assert max(r.v_max_mps for r in report.robots) <= v * (1 + swing)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"beta_rad": np.radians(29)}, "field of view"),
        ({"v_max_mps": 0.8}, "speed"),
        ({"omega_max_rps": np.radians(4.5)}, "turning"),
        ({"robot_distance_m": 3.2}, "robots apart"),
        ({"robot_radius_m": 3.2}, "target apart"),
        ({"range_min_m": 3.2}, "near range"),
        ({"range_max_m": 3.1}, "far range"),
    ],
)
def test_every_limit_is_kept_or_named(change, rule):
    slots = Slots(3.183, ring_angles(6))
    generous = Limits(BETA, "unicycle", 0.0, 0.9, 0.1, 1.0, 3.1, 1.0, 4.0)
    if rule == "field of view":
        slots = Slots(3.183, ring_angles(5))
    assert check(ARTICLE, slots, generous).feasible
    assert broken(check(ARTICLE, slots, replace(generous, **change))) == [rule]


def test_a_target_with_size_takes_its_share_of_the_view():
    slots = circle(6, 1.4)
    seen = check(ARTICLE, slots, replace(SEEING, target_radius_m=0.3))
    alone = check(ARTICLE, slots, SEEING)
    lost = alone.robots[0].margin_rad - seen.robots[0].margin_rad
    assert lost == pytest.approx(np.arcsin(0.3 / 1.4))
    assert (seen.least_scale_m, seen.greatest_scale_m) == pytest.approx((0.7646, 2.498), abs=5e-4)
    inside = check(ARTICLE, circle(6, 0.2), replace(SEEING, target_radius_m=0.3))
    assert broken(inside) == ["field of view", "target apart"]


def test_a_flying_camera_is_not_bound_by_curvature():
    flying = replace(SEEING, drive="flying")
    report = check(ARTICLE, circle(5, 30.0), flying)
    assert report.feasible
    assert report.critical_scale_m is None
    assert max(r.bearing_rad for r in report.robots) == 0
    assert np.degrees(report.robots[0].omega_rps) == pytest.approx(3.57, abs=5e-3)
    near = check(ARTICLE, circle(5, 0.5), replace(flying, target_radius_m=0.3))
    assert broken(near) == ["field of view"]  # d < R / sin(beta) = 0.6 m.


def test_what_stands_or_spins_is_reported_too():
    still = check(PlanarMotion(0, 0, 0.4, 0.0, 0.0), circle(5, 1.0), SEEING)
    assert still.feasible
    assert still.kappa_max_1pm == 0
    spinning = check(PlanarMotion(0, 0, 0.4, 0.0, 0.5), circle(5, 1.0), SEEING)
    assert broken(spinning) == ["field of view"]
    assert spinning.kappa_max_1pm is None
    alone = check(PlanarMotion(0, 0, 0, 1, 0), circle(1, 1.0), replace(SEEING, robot_distance_m=9))
    assert alone.robots_apart_m is None
    assert alone.feasible


def test_a_margin_allows_for_delay_and_noise_or_is_named():
    """What |omega_ri| tau + v_ri tau / d + noise comes to at its worst."""
    tau, noise, d = 0.1, np.radians(0.5), 3.0
    refs = robot_references(ARTICLE, circle(6, d))
    error = np.abs(refs.omega_rps) * tau + refs.v_mps * tau / d + noise
    limits = replace(SEEING, delay_s=tau, bearing_noise_rad=noise, margin_rad=error.max())
    assert check(ARTICLE, circle(6, d), limits).feasible
    scarce = replace(limits, margin_rad=error.max() - 1e-6)
    assert broken(check(ARTICLE, circle(6, d), scarce)) == ["margin"]
    assert "margin" not in {rule.name for rule in check(ARTICLE, circle(6, d), SEEING).rules}


@given(st.floats(0.02, 50), st.floats(1.2, 3), st.floats(0.02, 50))
def test_the_nearest_scale_is_feasible_and_at_the_edge_of_what_is(least, width, factor):
    greatest, wished = least * width, least * factor
    if least <= wished <= greatest:
        return
    nearest = nearest_scale(lambda d: least <= d <= greatest, wished)
    edge = min(max(wished, least), greatest)
    assert least <= nearest <= greatest
    assert nearest == pytest.approx(edge, abs=1.02e-3)
