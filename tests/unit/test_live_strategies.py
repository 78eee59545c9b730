"""Formations that look ahead: in view for the whole lap, and smooth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from services.kernels.rigid import apply, inverse
from services.planner.errors import PlannerError
from services.planner.forecast import PathForecast
from services.planner.foreknowledge import Foreknowledge
from services.planner.formation import FormationSettings
from services.planner.known_motion import KnownMotion, greatest_curvature, known_path
from services.planner.planar import PlanarMotion, Slots, robot_references
from services.planner.quintic import Course
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.scale_rules import ScaleRules
from services.planner.strategies.open import open_strategy
from services.planner.tracks import spatial

pytestmark = pytest.mark.unit

BETA_RAD = math.radians(30.0)
ELLIPSE = ("ellipse", (25.0, 12.6157), 200.0)
KNOWN = Foreknowledge(
    lambda drive: replace(Limits(BETA_RAD), drive=drive), known_path(*ELLIPSE, 4097)
)
DRIVEN = known_path(*ELLIPSE, 751)
states = st.floats(-2.0, 2.0)


def opened(strategy, radius_m, known=KNOWN, **more):
    formation = FormationSettings(
        strategy=strategy, cameras=5, radius_m=radius_m, elevation_deg=0.0, drive="unicycle", **more
    )
    return open_strategy(formation.strategy_settings(), known)


def lap(strategy, driven=DRIVEN):
    """Return (T, N) level arms in the frame of the target as complex numbers, and rates."""
    places, rates = [], []
    for target, t_s in zip(spatial(driven.target).each(), driven.t_s, strict=True):
        views = strategy.plan(target, float(t_s)).views
        eyes = apply(inverse(target.T), np.array([view.T[:3, 3] for view in views]))
        places.append(eyes[:, 0] + 1j * eyes[:, 1])
        linear = np.array([view.linear for view in views]) - target.linear
        linear = (linear - np.cross(target.angular, eyes @ target.T[:3, :3].T)) @ target.T[:3, :3]
        rates.append(linear[:, 0] + 1j * linear[:, 1])
    return np.array(places), np.array(rates)


def bearings(places, rates, target=DRIVEN.target):
    swing = rates / places
    slots = Slots(
        np.abs(places[:, 0]),
        np.angle(places),
        d_dot=(swing.real * np.abs(places))[:, 0],
        theta_dot=swing.imag,
        nominal_rad=ring_angles(5),
    )
    return np.abs(robot_references(target, slots).bearing_rad)


@pytest.mark.parametrize(
    ("name", "radius_m"),
    [("adaptive_scale", 3.183), ("constant_angles", 5.0), ("adaptive_angles", 5.0)],
)
def test_with_the_path_known_the_target_is_in_view_all_along(name, radius_m):
    places, rates = lap(opened(name, radius_m))
    assert bearings(places, rates).max() <= BETA_RAD + 1e-5
    if name == "adaptive_scale":
        assert np.abs(places).max() > 4.2  # What bumps over the whole motion reach.
    if name == "constant_angles":
        expected = np.radians([-108, -36, 57.36, 102.29, 167.14])
        np.testing.assert_allclose(np.angle(places), expected + 0 * places.real, atol=1e-4)


@given(*[states] * 5, st.floats(0.5, 5.0), st.floats(0.0, 5.0), st.floats(0.5, 5.0))
def test_a_course_is_smooth_and_ends_safe(value, rate, push, goal, safe, move_s, rest_s, back_s):
    rows = (value, rate, push, goal, safe, move_s, move_s + rest_s, back_s)
    course = Course(np.zeros(1), *(np.array([each]) for each in rows))
    np.testing.assert_allclose(course.at(0.0)[:, 0], [value, rate, push], atol=1e-9)
    end = course.at(move_s + rest_s + back_s + 1.0)
    np.testing.assert_allclose(end[:, 0], [safe, 0, 0], atol=1e-9)
    t_s, h = np.linspace(0.01, 15.0, 50), 1e-5
    slope = (course.at(t_s + h) - course.at(t_s - h))[:2] / (2 * h)
    # The third derivative has steps where a move begins or ends.
    np.testing.assert_allclose(slope, course.at(t_s)[1:], atol=2e-2)


@given(
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.floats(0.1, 1),
    st.floats(0.3, 4),
    st.floats(0.1, 1.4),
    st.integers(1, 9),
)
def test_the_worst_corner_is_that_of_the_planar_formulas(d_dot, omega, v, d_m, view, num):
    slots = Slots(d_m, ring_angles(num), d_dot=d_dot)
    target = PlanarMotion(0.0, 0.0, 0.0, v, omega)
    references = robot_references(target, slots)
    assume((np.abs(references.v_mps) > 1e-6).all())  # Who stands has no bearing to speak of.
    worst = np.abs(references.bearing_rad).max()
    ahead = PlanarMotion(0.0, 0.0, 0.0, np.array([v]), np.array([omega]))
    rules = ScaleRules(ahead, 0.0, np.inf, np.inf, view, 0.0, num)
    excess = rules.held(np.array([[d_m]]), np.array([[d_dot]]), np.arange(1))
    if abs(worst - view) > 1e-6:
        assert (excess[0, 0] > 0) == (worst > view)


def test_the_target_is_found_on_its_path_by_where_it_is():
    forecast = PathForecast(KNOWN.path)
    path = KNOWN.path.target
    row = 1000
    at = PlanarMotion(path.x_m[row], path.y_m[row], path.phi_rad[row], path.v_mps[row] / 2, 0.0)
    assert forecast.locate(at) == pytest.approx(KNOWN.path.t_s[row], abs=1e-6)
    ahead = forecast.ahead(at, np.array([0.0, 20.0])).target
    later = np.interp(KNOWN.path.t_s[row] + 10.0, KNOWN.path.t_s, path.v_mps)
    np.testing.assert_allclose(ahead.v_mps, [path.v_mps[row] / 2, later / 2], rtol=1e-6)
    off = replace(at, x_m=at.x_m + 10.0)
    assert forecast.locate(off) is None


def test_an_instant_told_twice_has_one_answer_and_a_change_of_mind_is_no_jump():
    strategy = opened("adaptive_scale", 3.0)
    targets = spatial(DRIVEN.target).each()
    for row in range(5):
        plan = strategy.plan(targets[row], float(DRIVEN.t_s[row]))
    again = strategy.plan(targets[4], float(DRIVEN.t_s[4]))
    other = strategy.plan(targets[5], float(DRIVEN.t_s[4]))
    assert again.radius_m == plan.radius_m == other.radius_m


def test_a_path_that_nobody_told_is_refused_by_name():
    with pytest.raises(PlannerError, match="no path is known"):
        opened("adaptive_scale", 1.0, Foreknowledge(), forecast="path")


LAP_S, NUM_LAP, HORIZON_S = 120.0, 121, 12.0
shares = st.floats(-1.0, 1.0)


def smooth_lap(shape):
    """A closed path of no great curvature: a circle of 8 m, its radius and its pace in waves."""
    a, b, phase, hurry = shape
    tau = 2 * np.pi * np.linspace(0.0, 1.0, 40 * (NUM_LAP - 1) + 1)
    at = tau + 0.2 * hurry * np.sin(tau)
    at_dots = 1 + 0.2 * hurry * np.cos(tau), -0.2 * hurry * np.sin(tau), -0.2 * hurry * np.cos(tau)
    # z = sum r_k e^(j (k tau)), and its derivatives by the chain rule.
    waves = [(1, 8.0), (-1, 1.5 * a), (2, 0.6 * b * np.exp(1j * np.pi * phase))]
    d1, d2, d3 = (sum((1j * k) ** n * r * np.exp(1j * k * at) for k, r in waves) for n in (1, 2, 3))
    p1, p2, p3 = at_dots
    z1 = d1 * p1
    z2 = d2 * p1**2 + d1 * p2
    z3 = d3 * p1**3 + 3 * d2 * p1 * p2 + d1 * p3
    rate = 2 * np.pi / LAP_S
    z1, z2, z3 = z1 * rate, z2 * rate**2, z3 * rate**3
    z = sum(r * np.exp(1j * k * at) for k, r in waves)
    v = np.abs(z1)
    bow, bow_dot = (np.conj(z1) * z2).imag, (np.conj(z1) * z3).imag
    v_dot = (np.conj(z1) * z2).real / v
    omega_dot = bow_dot / v**2 - 2 * bow * v_dot / v**3
    phi = np.unwrap(np.angle(z1))
    target = PlanarMotion(z.real, z.imag, phi, v, bow / v**2, v_dot, omega_dot)
    return KnownMotion(np.linspace(0.0, LAP_S, len(tau)), target)


@settings(max_examples=5)
@given(
    st.tuples(shares, shares, shares, shares),
    st.sampled_from(("adaptive_scale", "constant_angles", "adaptive_angles")),
)
def test_what_is_feasible_once_stays_so_on_whatever_closed_path_is_known(shape, name):
    known = smooth_lap(shape)
    sharpest = greatest_curvature(known.target)
    radius_m = 0.9 * math.sin(BETA_RAD) / sharpest  # Where robots on even angles see it, standing.
    told = Foreknowledge(lambda drive: replace(Limits(BETA_RAD), drive=drive), known)
    more = {"radius_max_m": 2 * radius_m} if name == "adaptive_scale" else {}
    radius_m *= 1.0 if more else 1.4  # Angles give way where a regular polygon would look off.
    strategy = opened(name, radius_m, told, horizon_s=HORIZON_S, **more)
    every = known.every(40)
    places, rates = lap(strategy, every)
    assert bearings(places, rates, every.target).max() <= BETA_RAD + 1e-4


@pytest.mark.parametrize(
    ("name", "radius_m"), [("adaptive_scale", 3.183), ("adaptive_angles", 5.0)]
)
def test_turn_rates_on_live_courses_are_the_derivatives_of_their_headings(name, radius_m):
    strategy = opened(name, radius_m)
    targets = spatial(DRIVEN.target).each()
    for target, t_s in zip(targets, DRIVEN.t_s[:250], strict=False):
        strategy.plan(target, float(t_s))
        course = strategy._memory._now
        state = course.at(t_s)
        if np.abs(state[2]).max() > 1e-4:
            break
    else:
        raise AssertionError("no course moved")
    # On one course from here, as it goes on while nobody plans anew.
    step_s, phase = 1e-4, 2 * np.pi / ELLIPSE[2]
    t = float(t_s) + np.linspace(0.5, 3.0, 6)[:, None] + step_s * np.array([-2, -1, 0, 1, 2])
    t = t.ravel()
    a, b = ELLIPSE[1]
    s, c = np.sin(phase * t), np.cos(phase * t)
    x = a * np.stack([phase * c, -(phase**2) * s, -(phase**3) * c])
    y = b * np.stack([phase * s, phase**2 * c, -(phase**3) * s])
    v = np.hypot(x[0], y[0])
    v_dot = (x[0] * x[1] + y[0] * y[1]) / v
    omega = (x[0] * y[1] - y[0] * x[1]) / v**2
    omega_dot = (x[0] * y[2] - y[0] * x[2]) / v**2 - 2 * omega * v_dot / v
    zero = np.zeros_like(t)
    target = PlanarMotion(zero, zero, np.arctan2(y[0], x[0]), v, omega, v_dot, omega_dot)
    scale, theta = strategy.places(course, t, np.arange(len(course.value)))
    slots = Slots(scale[0], theta[0], scale[1], scale[2], theta[1], theta[2], ring_angles(5))
    told = robot_references(target, slots)
    phi = np.unwrap(told.phi_rad, axis=0).reshape(6, 5, -1)
    slope = (phi[:, 0] - 8 * phi[:, 1] + 8 * phi[:, 3] - phi[:, 4]) / (12 * step_s)
    assert np.abs(theta[1:]).max() + np.abs(scale[1:]).max() > 1e-4
    np.testing.assert_allclose(told.omega_rps.reshape(6, 5, -1)[:, 2], slope, atol=1e-6)


@pytest.mark.parametrize("name", ["adaptive_scale", "constant_angles"])
def test_a_run_after_a_reset_is_the_same_run(name):
    strategy = opened(name, 1.1, horizon_s=10.0, forecast="twist")
    zero = np.zeros(91)
    omega = np.where(np.arange(91) > 60, 0.18, 0.0)  # The turn of before is not known any more.
    motion = spatial(PlanarMotion(zero, zero, zero, zero + 0.3, omega)).each()

    def run():
        plans = (strategy.plan(target, k / 15) for k, target in enumerate(motion))
        return np.array([[view.T for view in plan.views] for plan in plans])

    first = run()
    assert np.ptp(first, axis=0).max() > 1e-3
    np.testing.assert_array_equal(run(), first)
