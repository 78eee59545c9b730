"""What a link does not carry waits at its sender, and is replaced by what is newer."""

import heapq

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.camera.under_way import LOST_AFTER_S, UnderWay

pytestmark = pytest.mark.unit


def told(most: int = 2) -> UnderWay[str]:
    """Give one whose mapper has spoken."""
    under_way: UnderWay[str] = UnderWay(most)
    assert under_way.heard(-1, 0.0) is None
    return under_way


def test_without_a_mapper_that_speaks_all_are_sent() -> None:
    under_way: UnderWay[str] = UnderWay(1)
    assert [under_way.offer(tick, f"{tick}", 0.0) for tick in range(50)] == [
        f"{tick}" for tick in range(50)
    ]
    assert under_way.num_replaced == 0


def test_of_those_that_wait_the_newest_goes_when_there_is_room() -> None:
    under_way = told(2)
    assert [under_way.offer(tick, f"{tick}", 0.1 * tick) for tick in range(5)] == [
        "0", "1", None, None, None,
    ]  # fmt: skip
    assert under_way.num_replaced == 2  # 2 and 3.
    assert under_way.heard(0, 0.5) == "4"
    assert under_way.heard(0, 0.5) is None  # Said again: 1 and 4 are still under way.
    assert under_way.offer(5, "5", 0.5) is None
    assert under_way.heard(4, 0.6) == "5"  # Who has 4 will not have 1 any more.
    assert under_way.offer(6, "6", 0.6) == "6"


def test_no_limit_is_none() -> None:
    under_way = told(0)
    assert all(under_way.offer(tick, "x", 0.0) for tick in range(100))


def test_what_is_never_heard_of_is_lost_and_holds_nobody_up_for_ever() -> None:
    under_way = told(1)
    assert under_way.offer(0, "0", 0.0) == "0"
    assert under_way.offer(1, "1", LOST_AFTER_S) is None
    assert under_way.offer(2, "2", LOST_AFTER_S + 0.1) == "2"


def test_a_mapper_that_goes_lets_what_waits_go() -> None:
    under_way = told(1)
    under_way.offer(0, "0", 0.0)
    assert under_way.offer(1, "1", 0.1) is None
    assert under_way.forget(0.2) == "1"
    assert under_way.offer(2, "2", 0.2) == "2"
    assert under_way.offer(3, "3", 0.2) == "3"


def test_a_new_run_that_counts_from_0_is_not_held_up_by_the_old_one() -> None:
    under_way = told(2)
    for tick in (1000, 1001):
        under_way.offer(tick, "old", 0.0)
    assert under_way.offer(0, "0", 0.1) is None
    assert under_way.heard(1000, 0.1) == "0"
    assert under_way.heard(1001, 0.2) is None
    assert under_way.offer(1, "1", 0.2) == "1"


def test_a_word_of_the_new_run_is_enough() -> None:
    """That of the old run's last may have been replaced by it."""
    under_way = told(2)
    for tick in (1000, 1001):
        under_way.offer(tick, "old", 0.0)
    under_way.offer(0, "0", 0.1)
    assert under_way.heard(1000, 0.1) == "0"
    under_way.offer(1, "1", 0.2)
    assert under_way.heard(0, 0.3) == "1"


def test_what_waited_is_not_sent_into_a_time_that_waits_for_all() -> None:
    under_way = told(1)
    under_way.offer(0, "0", 0.0)
    under_way.offer(1, "1", 0.1)
    under_way.drop()
    assert under_way.heard(0, 0.2) is None
    assert under_way.forget(0.3) is None


@given(
    most=st.integers(1, 4),
    carry_s=st.floats(0.01, 2.0),
    way_s=st.floats(0.0, 0.3),
    period_s=st.floats(0.02, 0.2),
)
def test_on_any_link_clouds_are_young_in_order_and_as_many_as_it_carries(
    most: int, carry_s: float, way_s: float, period_s: float
) -> None:
    """A link carries one cloud after the other, each in `carry_s`, and each way takes `way_s`."""
    under_way = told(most)
    events: list[tuple[float, int, str, int]] = [
        (tick * period_s, tick, "offer", tick) for tick in range(300)
    ]
    heapq.heapify(events)
    free_s, arrived, number = 0.0, [], 1000
    while events:
        now_s, _, what, tick = heapq.heappop(events)
        cloud = (
            under_way.offer(tick, tick, now_s) if what == "offer" else under_way.heard(tick, now_s)
        )
        if cloud is not None:
            free_s = max(free_s, now_s) + carry_s
            arrived.append((free_s + way_s, cloud))
            heapq.heappush(events, (free_s + 2 * way_s, number, "heard", cloud))
            number += 1
    ticks = [tick for _, tick in arrived]
    assert ticks == sorted(set(ticks))
    oldest_s = max(there_s - tick * period_s for there_s, tick in arrived)
    # It waits at most for a place, which is given back after one way there and back.
    assert oldest_s <= (most + 1) * carry_s + 3 * way_s + period_s
    lasting_s = arrived[-1][0]
    possible = min(len(ticks) + under_way.num_replaced, lasting_s / max(carry_s, period_s))
    window = most * carry_s / (carry_s + 2 * way_s + period_s)
    assert len(ticks) >= 0.9 * possible * min(1.0, window) - most - 1
