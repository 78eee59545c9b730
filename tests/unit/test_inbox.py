"""What waits for a service: the newest per slot, all of what must be kept, in fair order."""

import threading

import pytest

from services.runtime.inbox import MAX_QUEUED, Inbox

pytestmark = pytest.mark.unit


def drain(inbox: Inbox) -> list:
    items = []
    while (item := inbox.get(0)) is not None:
        items.append(item)
    return items


def test_a_newer_item_takes_the_older_ones_place() -> None:
    inbox = Inbox()
    for item in range(100):
        inbox.put_latest("a", item)
    assert drain(inbox) == [99]


def test_a_flooded_slot_does_not_starve_the_others() -> None:
    inbox = Inbox()
    inbox.put_latest("quiet", "quiet")
    for item in range(100):
        inbox.put_latest("flood", item)
    assert drain(inbox) == ["quiet", 99]


def test_a_stream_keeps_all_in_order() -> None:
    inbox = Inbox()
    for item in range(500):
        inbox.put_next("s", item)
    assert drain(inbox) == list(range(500))


def test_a_stream_that_nobody_reads_is_bounded_and_loses_its_oldest() -> None:
    inbox = Inbox()
    for item in range(MAX_QUEUED + 10):
        inbox.put_next("s", item)
    assert drain(inbox) == list(range(10, MAX_QUEUED + 10))


def test_closing_wakes_who_waits() -> None:
    inbox = Inbox()
    threading.Timer(0.01, inbox.close).start()
    assert inbox.get(None) is None


def test_many_writers_lose_nothing() -> None:
    inbox = Inbox()
    writers = [
        threading.Thread(target=lambda n=n: [inbox.put_next(n, (n, i)) for i in range(200)])
        for n in range(4)
    ]
    for writer in writers:
        writer.start()
    got = [inbox.get(5) for _ in range(800)]
    for n in range(4):
        assert [i for m, i in got if m == n] == list(range(200))
