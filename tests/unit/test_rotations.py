"""Rotations by the dozen are those of the kernels, one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.kernels.rigid import rotation_exp, rotation_log
from services.planner.rotations import exps, left_jacobians, logs

pytestmark = pytest.mark.unit


def vectors(seed):
    """Draw turns of all sizes: tiny, zero, half a turn, and any."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(12, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = np.array([0, 1e-12, 1e-8, 1e-5, 9.9e-5, 1.01e-4, np.pi, np.pi - 1e-9, 3, 2, 1, 0.1])
    return axes * angles[:, None]


@given(st.integers(0, 2**32 - 1))
def test_each_is_what_the_kernel_makes_of_it(seed):
    w = vectors(seed)
    R = np.array([rotation_exp(each) for each in w])
    np.testing.assert_allclose(exps(w), R, atol=1e-14)
    expected = np.array([rotation_log(each) for each in R])
    # Half a turn has two vectors.
    found = logs(R)
    half = np.linalg.norm(expected, axis=1) > np.pi - 1e-6
    np.testing.assert_allclose(found[~half], expected[~half], atol=1e-12)
    np.testing.assert_allclose(exps(found), R, atol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_the_jacobian_is_the_derivative_of_the_rotation(seed):
    rng = np.random.default_rng(seed)
    w, w_dot, step = vectors(seed), rng.normal(size=(12, 3)), 1e-5
    turns = exps(w + step * w_dot) @ exps(w - step * w_dot).transpose(0, 2, 1)
    spin = np.einsum("nij,nj->ni", left_jacobians(w), w_dot)
    np.testing.assert_allclose(logs(turns) / (2 * step), spin, atol=1e-8)
