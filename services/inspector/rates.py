"""How often a key is sent, by its sender's own numbers: a slow listener cannot falsify it.

`seq` counts what was sent, `t_pub_ns` says when; what arrived here is counted beside it, so that
what was lost on the way, or let go by the listener itself, is told and not taken for the rate.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from services.inspector.header import Header

_SILENT_GAPS = 3.0
"""A key is silent when it stays away for so many of its own gaps, and a second."""

_MAX_SENDERS = 16


class Arrival(NamedTuple):
    """One message, and what its number tells of those before it."""

    received_ns: int
    num_bytes: int
    step: int
    """How many the sender had sent since the last that came; 0: nothing to compare it with."""
    gap_ns: int
    """By the sender's clock since the last that came; 0: not known."""
    numbered: bool


class Span(NamedTuple):
    """One key over some time."""

    received: int
    rate_hz: float | None
    """Of sending; None: fewer than two messages of one sender."""
    min_gap_s: float | None
    """Between neighbours in the sender's numbering, by the sender's clock; so the next two."""
    max_gap_s: float | None
    std_gap_s: float | None
    mean_bytes: float
    min_bytes: int
    max_bytes: int
    silent_s: float | None
    """Since the last message, if that is long for this key."""

    @property
    def bandwidth(self) -> float | None:
        """Bytes per second that the sender sends, had all of them the mean size."""
        return None if self.rate_hz is None else self.rate_hz * self.mean_bytes


@dataclass
class KeyRate:
    """Counts one key's messages: totals for ever, arrivals for the last `window_s`."""

    window_s: float = float("inf")
    received: int = 0
    sent: int = 0
    """As its senders numbered them, from the first to the last that came."""
    unnumbered: int = 0
    """Payloads without a valid envelope."""
    restarts: int = 0
    several_senders: bool = False
    """Whether two have spoken by turns."""
    last_received_ns: int = 0
    _last: dict[str, Header] = field(default_factory=dict)
    """Of each process that has sent, by `boot`; the newest sender is the last."""
    _arrivals: deque[Arrival] = field(default_factory=deque)

    def add(self, header: Header | None, num_bytes: int, received_ns: int) -> None:
        """Count a message; `header` is None when it has no valid envelope."""
        step, gap_ns = 0, 0
        self.received += 1
        if header is None:
            self.unnumbered += 1
        else:
            step, gap_ns = self._since_last(header)
            self.sent += step or 1
        self.last_received_ns = received_ns
        self._arrivals.append(Arrival(received_ns, num_bytes, step, gap_ns, header is not None))
        self._forget(received_ns)

    @property
    def lost(self) -> int:
        """Messages that were sent and did not come, wherever they were lost."""
        return self.sent - (self.received - self.unnumbered)

    def span(self, now_ns: int) -> Span:
        """Tell of the window that ends now (wall clock of the receiver)."""
        self._forget(now_ns)
        arrivals = self._arrivals
        steps = sum(each.step for each in arrivals if each.gap_ns)
        gaps_s = sum(each.gap_ns for each in arrivals) * 1e-9
        neighbours_s = np.array([each.gap_ns for each in arrivals if each.step == 1]) * 1e-9
        sizes = [each.num_bytes for each in arrivals] or [0]
        rate_hz = steps / gaps_s if gaps_s > 0 else None
        age_s = (now_ns - self.last_received_ns) * 1e-9
        return Span(
            received=len(arrivals),
            rate_hz=rate_hz,
            min_gap_s=float(neighbours_s.min()) if neighbours_s.size else None,
            max_gap_s=float(neighbours_s.max()) if neighbours_s.size else None,
            std_gap_s=float(neighbours_s.std()) if neighbours_s.size > 1 else None,
            mean_bytes=sum(sizes) / len(sizes),
            min_bytes=min(sizes),
            max_bytes=max(sizes),
            silent_s=age_s if age_s > max(1.0, _SILENT_GAPS / (rate_hz or 1.0)) else None,
        )

    @property
    def last(self) -> Header | None:
        """The newest envelope."""
        return next(reversed(self._last.values()), None)

    def _since_last(self, header: Header) -> tuple[int, int]:
        newest = self.last
        before = self._last.pop(header.boot, None)
        self._last[header.boot] = header
        if before is None:
            self.restarts += newest is not None
            if len(self._last) > _MAX_SENDERS:
                del self._last[next(iter(self._last))]
            return 0, 0
        self.several_senders |= before is not newest
        step, gap_ns = header.seq - before.seq, header.t_pub_ns - before.t_pub_ns
        if step <= 0:
            return 0, 0  # Said again, or out of order.
        return step, max(0, gap_ns)  # A clock that was set back tells nothing.

    def _forget(self, now_ns: int) -> None:
        if self.window_s == float("inf"):
            return
        oldest_ns = now_ns - round(self.window_s * 1e9)
        while self._arrivals and self._arrivals[0].received_ns < oldest_ns:
            self._arrivals.popleft()


def as_plain(key: str, rate: KeyRate, now_ns: int, declared_hz: float, here: int) -> dict[str, Any]:
    """Say a key's figures in plain numbers: SI units, None for what is not known.

    Args:
        key: Whose. rate: Its counts. now_ns: Wall clock of the receiver.
        declared_hz: Its row's rate. here: How many samples the listener itself let go.
    """
    span = rate.span(now_ns)
    return {
        "key": key,
        "declared_hz": declared_hz,
        **span._asdict(),
        "bytes_per_s": span.bandwidth,
        "received_in_all": rate.received,
        "sent_in_all": rate.sent,
        "lost": max(0, rate.lost - here),
        "dropped_here": here,
        "without_envelope": rate.unnumbered,
        "restarts": rate.restarts,
    }
