"""Poses: the laws that make a quaternion and a matrix the same thing."""

import numpy as np
import pytest

from schemas.geometry import Pose

pytestmark = pytest.mark.unit


def random_transform(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    if np.linalg.det(q) < 0:
        q[:, 0] *= -1
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = q, rng.normal(size=3)
    return T


@pytest.mark.parametrize("seed", range(200))
def test_a_matrix_through_a_pose_is_the_same_matrix(seed: int) -> None:
    T = random_transform(np.random.default_rng(seed))
    np.testing.assert_allclose(Pose.from_matrix(T).matrix(), T, atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_have_no_singularity(axis: int) -> None:
    T = np.diag([-1.0, -1.0, -1.0, 1.0])
    T[axis, axis] = 1.0
    np.testing.assert_allclose(Pose.from_matrix(T).matrix(), T, atol=1e-12)


@pytest.mark.parametrize("seed", range(50))
def test_the_quaternion_is_canonical(seed: int) -> None:
    pose = Pose.from_matrix(random_transform(np.random.default_rng(seed)))
    assert np.linalg.norm(pose.orientation) == pytest.approx(1.0, abs=1e-12)
    assert pose.orientation[3] >= 0
