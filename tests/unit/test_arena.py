"""Laws of the ground on which an object is looked for."""

import re

import pytest

from services.launcher.arena import refuse_what_leaves

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("semi_axes_m", [(1.6, 1.2), (60.0, 50.0), (130.0, 120.0), (500.0, 3.0)])
def test_the_ground_that_is_suggested_holds_the_way(semi_axes_m):
    with pytest.raises(ValueError, match="leaves the arena") as refused:
        refuse_what_leaves((-1.0, -1.0, 1.0, 1.0), "ellipse", semi_axes_m, 100.0, None)
    said = re.search(r"--arena (\S+) (\S+) (\S+) (\S+) or more", str(refused.value))
    x_0, y_0, x_1, y_1 = (float(each) for each in said.groups())
    assert x_0 <= -semi_axes_m[0] - 0.4
    refuse_what_leaves((x_0, y_0, x_1, y_1), "ellipse", semi_axes_m, 100.0, None)
