"""The filter's equations: arcs, their derivatives, and Bayes' rule."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.kernels.rigid import planar
from services.planner.motion import Motion
from services.planner.turn_model import Agility, Belief, correct, moved, predict, wrap

pytestmark = pytest.mark.unit

AGILITY = Agility(0.2, 0.3)
FAR = st.floats(-50, 50)
ANGLE = st.floats(-np.pi, np.pi)
SPEED = st.one_of(st.just(0.0), st.floats(-3, 3))
TURN = st.one_of(st.just(0.0), st.floats(-1e-5, 1e-5), st.floats(-4, 4))
STATES = st.tuples(FAR, FAR, ANGLE, SPEED, TURN).map(np.array)
TIMES = st.floats(0, 1)


def difference(one, other):
    """Return one - other with the headings' difference the short way round."""
    gap = one - other
    gap[2] = wrap(gap[2])
    return gap


def random_belief(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5)) * rng.uniform(0.01, 1, 5)
    return Belief(rng.normal(size=5), root @ root.T + 1e-6 * np.eye(5))


@given(STATES, TIMES)
def test_the_target_drives_the_arc_of_a_unicycle(state, dt_s):
    x, y, phi, v, omega = state
    ahead = v * np.array([np.cos(phi), np.sin(phi), 0.0])
    frame = Motion(planar(x, y, phi), ahead, np.array([0, 0, omega])).predicted(dt_s)
    there, _ = moved(state, dt_s)
    np.testing.assert_allclose(planar(*there[:3]), frame.T, atol=1e-9)
    assert (there[3], there[4]) == (v, omega)


@given(STATES, TIMES, TIMES)
def test_two_arcs_are_one(state, one_s, other_s):
    apart, _ = moved(moved(state, one_s)[0], other_s)
    np.testing.assert_allclose(difference(apart, moved(state, one_s + other_s)[0]), 0, atol=1e-9)


@given(STATES, TIMES)
def test_the_derivative_is_the_differences_limit(state, dt_s):
    _, F = moved(state, dt_s)
    h = 1e-6
    for column, step in enumerate(h * np.eye(5)):
        ahead, behind = moved(state + step, dt_s)[0], moved(state - step, dt_s)[0]
        np.testing.assert_allclose(F[:, column], difference(ahead, behind) / (2 * h), atol=1e-6)


@given(st.integers(0, 10_000), st.sampled_from([2, 3]))
def test_a_correction_is_bayes_rule(seed, num_measured):
    before, rng = random_belief(seed), np.random.default_rng([seed, 1])
    H, variances = np.eye(5)[:num_measured], rng.uniform(1e-3, 1, num_measured)
    measured = before.mean[:num_measured] + rng.normal(size=num_measured) * 0.1
    after, distance = correct(before, measured.copy(), variances)
    information = np.linalg.inv(before.cov) + H.T @ np.diag(1 / variances) @ H
    np.testing.assert_allclose(after.cov, np.linalg.inv(information), rtol=1e-5, atol=1e-8)
    gap = measured - H @ before.mean
    shift = after.cov @ H.T @ (gap / variances)
    np.testing.assert_allclose(difference(after.mean, before.mean), shift, rtol=1e-6, atol=1e-9)
    S = H @ before.cov @ H.T + np.diag(variances)
    assert distance == pytest.approx(gap @ np.linalg.inv(S) @ gap)


@given(st.integers(0, 1000), st.floats(-20, 20))
def test_whole_turns_of_a_measured_heading_are_nothing(seed, turns):
    before = random_belief(seed)
    measured = before.mean[:3] + 0.1
    turned = measured + np.array([0, 0, round(turns) * 2 * np.pi])
    one, other = (correct(before, z, np.full(3, 0.1)) for z in (measured, turned))
    np.testing.assert_allclose(one[0].mean, other[0].mean, atol=1e-9)
    assert -np.pi <= other[0].mean[2] <= np.pi


def test_what_is_predicted_is_what_random_accelerations_do():
    start = Belief(np.array([0, 0, 0.3, 1.0, 0.5]), 1e-12 * np.eye(5))
    rng, fine, num, dt_s = np.random.default_rng(4), 1e-2, 4000, 0.4
    states = np.repeat(start.mean[:, None], num, axis=1)
    for _ in range(round(dt_s / fine)):
        x, y, phi, v, omega = states
        states = np.stack(
            [
                x + fine * v * np.cos(phi + omega * fine / 2),
                y + fine * v * np.sin(phi + omega * fine / 2),
                phi + fine * omega,
                v + AGILITY.linear * np.sqrt(fine) * rng.normal(size=num),
                omega + AGILITY.angular * np.sqrt(fine) * rng.normal(size=num),
            ]
        )
    found = predict(start, dt_s, AGILITY)
    np.testing.assert_allclose(found.mean, states.mean(axis=1), atol=0.02)
    scale = np.sqrt(np.outer(np.diag(found.cov), np.diag(found.cov)))
    np.testing.assert_allclose(np.cov(states) / scale, found.cov / scale, atol=0.12)


@settings(max_examples=60)
@given(
    st.integers(0, 1000),
    st.lists(st.tuples(st.floats(0, 2), st.sampled_from([2, 3]), st.floats(1e-3, 10)), max_size=30),
)
def test_the_covariance_stays_symmetric_and_positive(seed, steps):
    rng, belief = np.random.default_rng(seed), random_belief(seed)
    for dt_s, num_measured, sigma in steps:
        belief = predict(belief, dt_s, AGILITY)
        measured = belief.mean[:num_measured] + sigma * rng.normal(size=num_measured)
        belief, _ = correct(belief, measured, np.full(num_measured, sigma**2))
        assert np.array_equal(belief.cov, belief.cov.T)
        assert np.linalg.eigvalsh(belief.cov).min() > 0
        assert -np.pi <= belief.mean[2] <= np.pi
