"""What courses are held against does what the planar formulas, its slow twin, say."""

from dataclasses import replace

import numpy as np
import pytest

from services.kernels.courses import pace
from services.planner.angle_rules import AngleRules
from services.planner.menu import NUM_STEPS, menu
from services.planner.planar import PlanarMotion, Slots, robot_references
from services.planner.quintic import Course, fading
from services.planner.ring import ring_angles
from services.planner.scale_rules import ScaleRules

pytestmark = pytest.mark.unit

NUM, HORIZON_S, D_M, VIEW_RAD = 4, 20.0, 3.0, 0.6
MENU = menu(HORIZON_S)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture
def target(rng):
    zero, v = np.zeros(NUM_STEPS), rng.uniform(0.2, 1.0, NUM_STEPS)
    return PlanarMotion(zero, zero, zero, v, *rng.normal(0, 0.05, (3, NUM_STEPS)))


def off_view(target, slots, view_rad):
    """What is broken, in bearings, for those robots that move."""
    return np.abs(robot_references(target, slots).bearing_rad) - view_rad


def test_robots_are_as_fast_as_the_planar_formulas_say(rng, target):
    scale, theta = rng.normal(2.0, 0.5, (3, NUM_STEPS)), rng.normal(0, 1, (3, NUM_STEPS, NUM))
    speed, turn = np.empty((2, NUM_STEPS, NUM))
    motion = np.array([target.v_mps, target.omega_rps, target.v_dot, target.omega_dot])
    pace(motion, scale, theta, speed, turn)
    slots = Slots(scale[0], theta[0], scale[1], scale[2], theta[1], theta[2])
    twin = robot_references(target, slots)
    np.testing.assert_allclose(speed, twin.v_mps, rtol=1e-12)
    np.testing.assert_allclose(turn, twin.omega_rps, rtol=1e-9, atol=1e-12)


def test_a_robot_that_stands_neither_drives_nor_turns():
    speed, turn = np.ones((2, 1, 1))
    pace(np.zeros((4, 1)), np.array([[1.0], [0], [0]]), np.zeros((3, 1, 1)), speed, turn)
    assert speed[0, 0] == turn[0, 0] == 0.0


def test_angles_that_look_off_are_those_whose_bearing_is_too_great(rng, target):
    theta_0 = ring_angles(NUM)
    rules = AngleRules(target, theta_0, theta_0, D_M, VIEW_RAD)
    theta = theta_0 + rng.normal(0, 0.5, (NUM_STEPS, NUM))
    theta_dot = rng.normal(0, 0.05, theta.shape)
    excess = rules.held(theta, theta_dot, np.arange(NUM))
    over = off_view(target, Slots(D_M, theta, theta_dot=theta_dot, nominal_rad=theta_0), VIEW_RAD)
    clear = np.abs(over) > 1e-9
    np.testing.assert_array_equal(excess[clear] > 0, over[clear] > 0)
    assert 0.1 < (excess > 0).mean() < 0.9


def courses(known):
    """(C, K, M) values and rates, by the polynomials themselves."""
    value, rate, push, safe, ideal = known
    after = MENU.after_s
    to = fading(after, MENU.move_s[:, None])[..., None]
    left = fading(after - MENU.leave_s[:, None], MENU.back_s[:, None])[:, 0][..., None]
    goal = (MENU.goal @ np.stack([value, rate, safe, ideal]))[:, None]
    moved = to[:, 0] * (value - goal) + to[:, 1] * rate + to[:, 2] * push
    moved += left * (goal - safe)
    moved[0] += safe
    return moved[:2]


def twin(rules, known, allowed, rows, worth_of):
    values, rates = courses(known)
    over = np.array([rules.held(*each, rows) for each in zip(values, rates, strict=True)]) - allowed
    broken = np.maximum(over, 0).mean(axis=1)
    fault = np.where(broken > 0, broken + np.where(over[:, -1] > 0, 1e3, 1.0), 0.0)
    return worth_of(values), fault


def compare(rules, known, rows, worth_of):
    allowed = np.full((NUM_STEPS, len(rows)), -1e-3)
    worth, fault = twin(rules, known, allowed, rows, worth_of)
    assert (fault == 0).any()
    assert (fault > 0).any()
    for least in (-np.inf, np.median(worth), np.nan):
        rated = rules.rated(MENU.table, known, allowed, np.full(len(rows), least), rows)
        np.testing.assert_allclose(rated.worth, worth, atol=1e-12)
        if np.isnan(least):
            # How badly a rule is broken is asked until a course is found that keeps it.
            asked = np.isfinite(rated.fault)
            np.testing.assert_allclose(rated.fault[asked], fault[asked], atol=1e-9)
            assert ((rated.fault == 0) == (fault == 0)).all()
        else:
            np.testing.assert_array_equal(rated.fault == 0, (fault == 0) & (worth > least))


def test_courses_of_angles_are_rated_as_one_by_one(rng, target):
    theta_0, rows = ring_angles(NUM), np.arange(NUM)
    rules = AngleRules(target, theta_0, theta_0, D_M, VIEW_RAD)
    moved = rng.normal(0, 1, (5, NUM)) * np.array([0.3, 0.03, 0.005, 0.2, 0.3])[:, None]
    moved[[0, 3, 4]] += theta_0
    compare(rules, moved, rows, lambda values: -np.abs(values - theta_0).mean(axis=1))


def test_courses_of_a_scale_are_rated_as_one_by_one(target):
    gentle = replace(target, omega_rps=0.3 * target.omega_rps)
    rules = ScaleRules(gentle, 0.5, 8.0, 2.0, VIEW_RAD, 0.1, NUM)
    known = np.array([[3.0], [0.05], [0.0], [1.5], [8.0]])
    compare(rules, known, np.arange(1), lambda values: values.mean(axis=1))


def test_a_course_is_what_its_polynomials_say(rng):
    start_s, *state = rng.normal(0, 1, (6, NUM))
    move_s, leave_s, back_s = 2.0 + rng.random(NUM), 4.0 + rng.random(NUM), 1.0 + rng.random(NUM)
    course = Course(start_s, *state, move_s, leave_s, back_s)
    value, rate, push, goal, safe = state
    tau = np.linspace(-1, 10, 60)[:, None] - start_s
    to, left = fading(tau, move_s), fading(tau - leave_s, back_s)[:, 0]
    moved = to[:, 0] * (value - goal) + to[:, 1] * rate + to[:, 2] * push + left * (goal - safe)
    moved[0] += safe
    np.testing.assert_allclose(course.at(np.linspace(-1, 10, 60)), moved, atol=1e-12)
    np.testing.assert_allclose(course.of(np.array([2])).at(3.0), course.at(3.0)[:, 2:3])
