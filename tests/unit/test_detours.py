"""Ways that must keep clear of each other, where some cannot."""

import numpy as np
import pytest

from services.kernels.detour import intrusion, part, trace
from services.planner.detours import bump

pytestmark = pytest.mark.unit

NUM_SAMPLES, ALLOWED_M, LONGER = 49, 0.3, 1e-3
SHARE = np.linspace(0, 1, NUM_SAMPLES)
TRIED_M = np.linspace(0, 3, 41)


def test_a_pair_that_nothing_parts_does_not_keep_others_from_being_parted():
    # The first two always fly together; the others change places, and meet half-way.
    start, end = np.radians([0.0, 0.0, 140.0, 220.0]), np.radians([40.0, 40.0, 220.0, 140.0])
    theta = start[:, None] + (end - start)[:, None] * SHARE
    range_m, climb = np.full_like(theta, 2.0), np.zeros_like(theta)
    allowed, radial = np.full((4, 4), ALLOWED_M), np.zeros(4, np.bool_)
    allowed[:2, :2] = 2 * ALLOWED_M  # So that no pair lacks more.
    out_m, shape = np.empty(4), bump(SHARE)
    part(range_m, theta, climb, radial, shape, TRIED_M, LONGER, allowed, 16, out_m)
    ways, steps = np.empty((4, NUM_SAMPLES, 3)), np.empty(4)
    for i in range(4):
        steps[i] = trace(range_m[i], theta[i], climb[i], False, shape, out_m[i], ways[i])
    assert intrusion(ways[2], ways[3], steps[2] + steps[3], ALLOWED_M) < LONGER * TRIED_M[1]
    np.testing.assert_array_equal(out_m[:2], 0.0)
