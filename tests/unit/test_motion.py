"""Motions of frames: prediction and what is carried along."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.kernels.rigid import planar, rotation_exp
from services.planner.motion import Motion, still

pytestmark = pytest.mark.unit


def random_motion(seed):
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_exp(rng.normal(size=3)), rng.normal(size=3)
    return Motion(T, rng.normal(size=3), rng.normal(size=3))


def assert_same(a, b, atol=1e-9):
    for left, right in ((a.T, b.T), (a.linear, b.linear), (a.angular, b.angular)):
        np.testing.assert_allclose(left, right, atol=atol)


@given(st.integers(0, 2**32 - 1), st.floats(0, 2), st.floats(0, 2))
def test_predicting_twice_is_predicting_once_for_both_times(seed, first, second):
    motion = random_motion(seed)
    assert_same(motion.predicted(first).predicted(second), motion.predicted(first + second))


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 2))
def test_predicting_forth_and_back_returns(seed, dt):
    motion = random_motion(seed)
    assert_same(motion.predicted(dt).predicted(-dt), motion)


@given(st.integers(0, 2**32 - 1))
def test_the_prediction_starts_with_the_given_twist(seed):
    motion, dt = random_motion(seed), 1e-6
    moved = motion.predicted(dt)
    np.testing.assert_allclose((moved.T[:3, 3] - motion.T[:3, 3]) / dt, motion.linear, atol=1e-4)


def test_a_unicycle_is_predicted_along_its_arc():
    speed, turn, dt = 0.5, 0.8, 1.5
    start = Motion(planar(0, 0, 0), np.array([speed, 0, 0]), np.array([0, 0, turn]))
    end = start.predicted(dt)
    radius, angle = speed / turn, turn * dt
    x, y = radius * np.sin(angle), radius * (1 - np.cos(angle))
    np.testing.assert_allclose(end.T, planar(x, y, angle), atol=1e-12)
    heading = [speed * np.cos(angle), speed * np.sin(angle), 0]
    np.testing.assert_allclose(end.linear, heading, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e-2))
def test_small_and_large_turns_agree_where_the_formula_changes(seed, scale):
    motion = random_motion(seed)
    unit = motion.angular / np.linalg.norm(motion.angular)
    below = Motion(motion.T, motion.linear, unit * scale * 0.999)
    above = Motion(motion.T, motion.linear, unit * scale * 1.001)
    np.testing.assert_allclose(below.predicted(1).T, above.predicted(1).T, atol=scale)


@given(st.integers(0, 2**32 - 1))
def test_carrying_is_associative(seed):
    a, b, c = (random_motion(seed + offset) for offset in range(3))
    assert_same(a.carry(b).carry(c), a.carry(b.carry(c)))


@given(st.integers(0, 2**32 - 1))
def test_a_still_identity_carries_everything_as_it_is(seed):
    motion = random_motion(seed)
    assert_same(still(np.eye(4)).carry(motion), motion, atol=0)
