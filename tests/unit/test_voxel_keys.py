"""Keys of voxels: back again as they were, and in their order."""

import numpy as np
import pytest

from services.kernels.voxel_keys import OFFSET, pack, unpack

pytestmark = pytest.mark.unit


def test_indices_come_back_and_sort_as_their_keys_do():
    rng = np.random.default_rng(5)
    near = rng.integers(-3, 3, (500, 3))
    far = rng.integers(-OFFSET, OFFSET, (500, 3))
    ends = np.array([[-OFFSET] * 3, [OFFSET - 1] * 3])
    indices = np.concatenate([near, far, ends])
    keys = pack(indices)
    assert keys.min() >= 0
    np.testing.assert_array_equal(unpack(keys), indices)
    i, j, k = indices.T
    np.testing.assert_array_equal(indices[np.lexsort((k, j, i))], unpack(np.sort(keys)))


def test_none_have_none():
    assert pack([]).shape == (0,)
    assert unpack(pack([])).shape == (0, 3)
