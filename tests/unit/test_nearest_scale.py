"""Laws of the search for the nearest feasible scale."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.planner.nearest_scale import nearest_scale

pytestmark = pytest.mark.unit


@given(st.floats(0.5, 0.99), st.floats(1.01, 1.5))
def test_of_two_sides_the_nearer_is_the_answer(low, high):
    found = nearest_scale(lambda d: d <= low or d >= high, 1.0, ratio=2.0)
    assert abs(found - 1.0) <= min(1.0 - low, high - 1.0) + 1e-3
    assert found <= low or found >= high


@pytest.mark.parametrize("edge_mm", range(13, 990, 83))
def test_a_round_edge_is_found_to_the_last_digit(edge_mm):
    edge_m = edge_mm * 1e-3
    assert nearest_scale(lambda d: d <= edge_m, 1.0) == pytest.approx(edge_m, abs=1e-12)


def test_what_holds_when_time_is_up_is_the_answer():
    tried = []

    def holds(scale_m):
        tried.append(scale_m)
        return scale_m <= 0.5

    found = nearest_scale(holds, 1.0, may_go_on=lambda: len(tried) < 30)
    assert found <= 0.5
    assert len(tried) <= 32
    assert nearest_scale(lambda _: False, 1.0, may_go_on=lambda: False) is None
