"""Health is derived, and cannot flatter."""

import pytest

from schemas.message import Envelope
from services.runtime.meter import StageMeter, TopicMeter

pytestmark = pytest.mark.unit


def metered(rate_hz: float, declared_hz: float, count: int = 50) -> tuple[TopicMeter, float]:
    meter = TopicMeter("k", declared_hz, sent=False)
    for i in range(count):
        meter.tick(i / rate_hz)
    return meter, (count - 1) / rate_hz


def number(seq: int, boot: str = "a") -> Envelope:
    return Envelope(seq=seq, src="s", boot=boot, t_pub_ns=0)


@pytest.mark.parametrize("rate_hz", [0.5, 15.0, 200.0])
def test_a_steady_stream_shows_its_rate(rate_hz: float) -> None:
    meter, now_s = metered(rate_hz, rate_hz)
    status = meter.status(now_s)
    assert status.rate_hz == pytest.approx(rate_hz)
    assert status.alive
    assert status.rate_ok


def test_a_stream_below_nine_tenths_of_its_promise_is_not_ok() -> None:
    meter, now_s = metered(13.0, 15.0)
    assert not meter.status(now_s).rate_ok
    meter, now_s = metered(14.0, 15.0)
    assert meter.status(now_s).rate_ok


def test_a_stream_that_stopped_is_dead_after_ten_periods_and_its_rate_falls() -> None:
    meter, now_s = metered(10.0, 10.0)
    assert meter.status(now_s + 0.9).alive
    late = meter.status(now_s + 1.1)
    assert not late.alive
    assert late.rate_hz == pytest.approx(1 / 1.1)
    assert not late.rate_ok


def test_a_stream_that_never_came_is_dead() -> None:
    assert not TopicMeter("k", 15.0, sent=False).status(0.0).alive


def test_gaps_in_the_numbering_are_losses_and_a_restart_is_not() -> None:
    meter = TopicMeter("k", 15.0, sent=False)
    for envelope in (number(0), number(1), number(5), number(0, "b"), number(2, "b")):
        meter.follow(envelope)
    assert meter.lost == 3 + 1


def test_a_key_of_any_length_has_a_status() -> None:
    key = "metrics/" + "x" * 300
    assert TopicMeter(key, 0.0, sent=False).status(0.0).key == key[:256]


def test_stages_add_up() -> None:
    stages = StageMeter()
    for _ in range(10):
        stages.add("fuse", 0.010)
    (row,) = stages.status()
    assert (row.name, row.count) == ("fuse", 10)
    assert row.total_s == pytest.approx(0.1)
    assert row.p50_ms == pytest.approx(10.0)
