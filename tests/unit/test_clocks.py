"""A clock that is off is told once, on either side, and so is its return."""

import pytest

from services.mapper.clocks import MAX_OFFSET_S, Clocks

pytestmark = pytest.mark.unit

NOW_NS = 1_700_000_000 * 10**9


def test_a_clock_that_agrees_is_not_mentioned() -> None:
    clocks = Clocks()
    for off_s in (-MAX_OFFSET_S, -0.1, 0.0, 0.1, MAX_OFFSET_S):
        assert clocks.note(0, NOW_NS + round(off_s * 1e9), NOW_NS) is None
        assert not clocks.is_off(0)


@pytest.mark.parametrize(("off_s", "words"), [(3600, "ahead of"), (-3600, "behind")])
def test_a_clock_that_is_off_is_told_once_and_so_is_its_return(off_s: int, words: str) -> None:
    clocks = Clocks()
    line = clocks.note(2, NOW_NS + off_s * 10**9, NOW_NS)
    assert line is not None
    assert f"camera 2: its stamps are 3600 s {words} our clock" in line
    assert clocks.note(2, NOW_NS + off_s * 10**9, NOW_NS) is None
    assert clocks.is_off(2)
    assert not clocks.is_off(1)
    assert clocks.note(2, NOW_NS, NOW_NS) == "camera 2: its stamps agree with our clock again"
    assert not clocks.is_off(2)


def test_stamps_of_the_beginning_of_time_are_no_trouble() -> None:
    assert "behind our clock" in (Clocks().note(0, 0, NOW_NS) or "")
    assert "ahead of our clock" in (Clocks().note(0, 2**63 - 1, NOW_NS) or "")
