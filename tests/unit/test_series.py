"""Figures of very many instants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.launcher.series import Series

pytestmark = pytest.mark.unit


@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.booleans()), min_size=1, max_size=120))
def test_sums_are_of_all_rows_however_few_are_kept(told):
    series, expected = Series("index", "value", kept=4), []
    for value, corrects in told:
        if corrects and expected:
            expected[-1] = value
            series.correct(len(expected) - 1, value)
        else:
            series.add(len(expected), value)
            expected.append(value)
    figures = series.figures("value")
    assert len(series) == len(expected)
    assert figures["mean"] == pytest.approx(np.mean(expected), abs=1e-9)
    assert figures["min"] == min(expected)
    assert figures["max"] == max(expected)
    assert figures["final"] == expected[-1]
    kept = series.values("index").astype(int)
    assert len(kept) <= 9  # Twice `kept`, and the newest.
    assert np.array_equal(series.values("value"), np.array(expected)[kept])
    assert kept[0] == 0
    assert kept[-1] == len(expected) - 1
    assert len(set(np.diff(kept[:-1]))) <= 1, "not an even choice"


def test_few_rows_are_all_kept_and_a_percentile_is_exact():
    series = Series("value", kept=51)
    for value in range(101):
        series.add(value)
    assert np.array_equal(series.values("value"), np.arange(101))
    assert (series.percentile("value", 50), series.percentile("value", 95)) == (50, 95)


def test_many_instants_are_as_large_as_few():
    series = Series("value")
    for value in range(100_000):
        series.add(value)
    assert len(series.values("value")) <= 2 * 4096 + 1
    assert series.figures("value")["mean"] == pytest.approx(49_999.5)
    assert series.percentile("value", 95) == pytest.approx(95_000, rel=1e-3)
