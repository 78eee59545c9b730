"""Rates come from the senders' numbers and stamps, whatever the listener misses."""

import numpy as np
import pytest

from schemas.codec import encode
from schemas.message import MessageError
from services.inspector.header import Header, read_header
from services.inspector.rates import KeyRate
from tests.examples import ENVELOPE, EXAMPLES

pytestmark = pytest.mark.unit

BEGIN_NS = 1_700_000_000_000_000_000


def send(rate, numbers, period_s=0.05, boot="a", late_s=0.0, num_bytes=100):
    """Let `rate` see these of a steady stream's messages; `late_s` is how slow the listener is."""
    for index, seq in enumerate(numbers):
        t_pub_ns = BEGIN_NS + round(seq * period_s * 1e9)
        received_ns = t_pub_ns + round(index * late_s * 1e9)
        rate.add(Header(int(seq), "camera/0", boot, t_pub_ns), num_bytes, received_ns)
    return received_ns


@pytest.mark.parametrize("seed", range(5))
def test_whatever_is_missed_the_rate_is_that_of_sending(seed):
    rng = np.random.default_rng(seed)
    rate = KeyRate()
    seen = np.flatnonzero(rng.random(200) < 0.4)
    now_ns = send(rate, seen, period_s=0.02)
    assert rate.span(now_ns).rate_hz == pytest.approx(50.0)
    assert rate.sent == seen[-1] - seen[0] + 1
    assert rate.lost == rate.sent - len(seen)


def test_a_slow_listener_does_not_slow_the_rate():
    rate = KeyRate()
    now_ns = send(rate, range(30), period_s=1 / 15, late_s=0.5)
    span = rate.span(now_ns)
    assert span.rate_hz == pytest.approx(15.0)
    assert span.max_gap_s == pytest.approx(1 / 15)
    assert span.std_gap_s == pytest.approx(0.0, abs=1e-6)


def test_gaps_are_those_between_neighbours_alone():
    rate = KeyRate()
    now_ns = send(rate, [0, 1, 5, 6], period_s=0.1)
    assert rate.span(now_ns).max_gap_s == pytest.approx(0.1)
    assert rate.lost == 3


def test_a_restart_is_no_loss():
    rate = KeyRate()
    send(rate, range(10), boot="a")
    send(rate, range(10), boot="b")
    assert (rate.lost, rate.restarts, rate.several_senders) == (0, 1, False)


def test_two_senders_at_once_are_told():
    rate = KeyRate()
    for seq in range(5):
        send(rate, [seq], boot="a")
        send(rate, [seq], boot="b")
    assert rate.several_senders
    assert rate.lost == 0


def test_the_window_forgets():
    rate = KeyRate(window_s=1.0)
    send(rate, range(10), period_s=0.1)  # At 10 Hz, then from second 2 on at 5 Hz.
    now_ns = send(rate, range(10, 20), period_s=0.2)
    span = rate.span(now_ns)
    assert span.rate_hz == pytest.approx(5.0)
    assert span.received == 6
    assert rate.received == 20


def test_who_stays_away_is_silent():
    rate = KeyRate()
    now_ns = send(rate, range(10), period_s=0.1)
    assert rate.span(now_ns + 900_000_000).silent_s is None
    assert rate.span(now_ns + 1_500_000_000).silent_s == pytest.approx(1.5)


def test_a_clock_that_is_set_back_spoils_one_gap_and_not_the_rate():
    rate = KeyRate()
    for seq in range(20):
        shift_ns = -3_600_000_000_000 if seq >= 10 else 0
        rate.add(Header(seq, "x", "a", BEGIN_NS + seq * 100_000_000 + shift_ns), 1, BEGIN_NS)
    assert rate.span(BEGIN_NS).rate_hz == pytest.approx(10.0, rel=0.06)


def test_bytes_per_second_are_those_that_are_sent():
    rate = KeyRate()
    now_ns = send(rate, range(0, 40, 2), period_s=0.05, num_bytes=1000)
    assert rate.span(now_ns).bandwidth == pytest.approx(20_000)


def test_what_has_no_envelope_is_counted_and_is_no_loss():
    rate = KeyRate()
    now_ns = send(rate, range(5))
    rate.add(None, 7, now_ns)
    assert (rate.unnumbered, rate.lost, rate.received) == (1, 0, 6)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_header_of_every_message_is_its_envelope(name):
    payload = encode(EXAMPLES[name][1], ENVELOPE).join()
    header = read_header(payload)
    assert header == Header(ENVELOPE.seq, ENVELOPE.src, ENVELOPE.boot, ENVELOPE.t_pub_ns)


def test_an_envelope_that_comes_last_is_found():
    import msgpack

    fields = {"tick": 3, "names": ["a"] * 3, **ENVELOPE.model_dump()}
    assert read_header(msgpack.packb(fields)).seq == ENVELOPE.seq


@pytest.mark.parametrize(
    "payload", [b"", b"\xc1", b"hello", b"\x80", b"\x81\xa1v\x01", b"\xff" * 600]
)
def test_what_has_no_envelope_is_refused(payload):
    with pytest.raises(MessageError):
        read_header(payload)


@pytest.mark.parametrize("seed", range(20))
def test_random_bytes_are_refused_and_nothing_worse(seed):
    rng = np.random.default_rng(seed)
    for _ in range(200):
        with pytest.raises(MessageError):
            read_header(rng.bytes(rng.integers(1, 700)))
