"""What the wire between the hosts of our tests does with packets."""

from pathlib import Path

import pytest

from benchmarks.wire import PERFECT, Quality, Wire

pytestmark = pytest.mark.unit


def sent(wire: Wire, num: int, octets: int = 1250) -> list[float]:
    """Send packets at once; return how long each takes, without those that never come."""
    free_s = dict.fromkeys(("a", "b"), 0.0)
    begun_s = min(filter(None, [wire._passes("a", "b", octets, free_s)]), default=0.0)
    came = [wire._passes("a", "b", octets, free_s) for _ in range(num - 1)]
    return [each - begun_s for each in came if each is not None]


def test_packets_take_their_time_and_their_turn() -> None:
    wire = Wire(("a", "b"), Path())
    wire.set({"a": Quality(delay_s=0.5, rate_bit_s=1e6, queue_s=0.1)})
    came = sent(wire, 30)
    assert came == sorted(came)
    assert came[4] == pytest.approx(5 * 0.01, abs=0.02)  # 1250 bytes at 1 Mbit/s: 10 ms each.
    assert 9 <= len(came) <= 12  # A tenth of a second of them may wait.
    assert wire.counts["a"].dropped == 29 - len(came)


def test_the_share_that_is_lost_is_the_share_that_was_asked_for_and_the_same_each_time() -> None:
    lost = []
    for _ in range(2):
        wire = Wire(("a", "b"), Path(), seed=3)
        wire.set({"a": Quality(loss=0.05, queue_s=1e9)})
        sent(wire, 10_000)
        lost.append(wire.counts["a"].lost)
    assert lost[0] == lost[1]
    assert 400 < lost[0] < 600


@pytest.mark.parametrize("end", ["a", "b"])
def test_nothing_passes_to_or_from_a_host_that_is_cut_off(end: str) -> None:
    wire = Wire(("a", "b"), Path())
    wire.set({"a": PERFECT})
    wire.cut(end)
    assert sent(wire, 10) == []
    wire.cut()
    assert len(sent(wire, 10)) == 9
