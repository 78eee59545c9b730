"""Ticks that follow the wall clock neither drift nor burst."""

import pytest

from services.simulator.pace import Pace

pytestmark = pytest.mark.unit


def test_small_delays_do_not_add_up() -> None:
    pace, now_s = Pace(0.1), 5.0
    pace.begin(now_s)
    for _ in range(100):
        now_s += pace.wait_s(now_s) + 0.01  # Each tick's work.
    assert now_s == pytest.approx(5.0 + 100 * 0.1 + 0.01)
    assert pace.overruns == 0


def test_a_late_tick_is_counted_and_followed_by_no_burst() -> None:
    pace = Pace(0.1)
    pace.begin(0.0)
    assert pace.wait_s(0.35) == 0.0
    assert pace.overruns == 1
    assert pace.wait_s(0.35) == pytest.approx(0.1)
    assert pace.overruns == 1
