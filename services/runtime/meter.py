"""Counting what flows and what it costs; health is derived from the topic table."""

import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from schemas.message import Envelope
from schemas.status import StageStatus, TopicStatus
from schemas.topics import Topic

ALIVE_PERIODS = 10  # openpilot's SubMaster: alive = newer than 10 periods.
MAX_KEY_LENGTH = 256
"""Of `TopicStatus`: a longer key is told cut off there; anybody may say anything on any key."""
RATE_SHARE = 0.9  # openpilot's SubMaster: freq_ok = at least 90 % of the declared rate.
_MOST = 2**63 - 1  # msgpack's integers end; a sender may number as it likes.
_WINDOW = 100  # Gaps that a rate is the mean of, as openpilot.


class TopicMeter:
    """One stream's figures, on the sending or the receiving side."""

    def __init__(self, key: str, declared_hz: float, *, sent: bool) -> None:
        self.key = key
        self.declared_hz = declared_hz
        self.sent = sent
        self.count = 0
        self.lost = 0
        self.bad = 0
        self.shared_memory = 0
        self._times_s: deque[float] = deque(maxlen=_WINDOW + 1)
        self._boot = ""
        self._seq = -1

    def tick(self, now_s: float, *, shared_memory: bool = False) -> None:
        """Count one message."""
        self.count += 1
        self.shared_memory += shared_memory
        self._times_s.append(now_s)

    def follow(self, envelope: Envelope) -> None:
        """Count what the sender numbered and we never saw; a restart begins anew."""
        if envelope.boot == self._boot and envelope.seq > self._seq:
            self.lost = min(self.lost + envelope.seq - self._seq - 1, _MOST)
        self._boot, self._seq = envelope.boot, envelope.seq

    def status(self, now_s: float) -> TopicStatus:
        """Derive alive and rate as of `now_s` (monotonic)."""
        times = self._times_s
        rate_hz = 0.0
        if len(times) > 1:
            # The open gap counts too: a stream that has stopped must not keep its old rate.
            span_s = max(times[-1] - times[0], 1e-9)
            open_s = now_s - times[-1]
            mean_gap_s = span_s / (len(times) - 1)
            rate_hz = 1.0 / max(mean_gap_s, open_s if open_s > 2 * mean_gap_s else 0.0)
        declared = self.declared_hz
        age_s = now_s - times[-1] if times else float("inf")
        return TopicStatus(
            key=self.key[:MAX_KEY_LENGTH],
            sent=self.sent,
            count=self.count,
            rate_hz=rate_hz,
            declared_hz=declared,
            alive=bool(times) and (declared == 0 or age_s < ALIVE_PERIODS / declared),
            rate_ok=declared == 0 or rate_hz >= RATE_SHARE * declared,
            lost=self.lost,
            bad=self.bad,
            shared_memory=self.shared_memory,
        )


class Meters:
    """All streams of one session; safe from any thread."""

    def __init__(self) -> None:
        self._meters: dict[tuple[str, bool], TopicMeter] = {}
        self._lock = threading.Lock()

    def of(self, topic: Topic[Any] | None, key: str, *, sent: bool) -> TopicMeter:
        """Return the figures of one stream, begun at its first use."""
        with self._lock:
            meter = self._meters.get((key, sent))
            if meter is None:
                declared_hz = 0.0 if topic is None else topic.rate_hz
                meter = self._meters[key, sent] = TopicMeter(key, declared_hz, sent=sent)
            return meter

    def __iter__(self) -> Iterator[TopicMeter]:
        with self._lock:
            meters = list(self._meters.values())
        return iter(meters)


class StageMeter:
    """Where a service's time goes, by named stage."""

    def __init__(self) -> None:
        self._recent_s: dict[str, deque[float]] = {}
        self._total_s: dict[str, float] = {}
        self._count: dict[str, int] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block as one run of stage `name`."""
        start_s = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - start_s)

    def add(self, name: str, seconds: float) -> None:
        """Count one run of stage `name` that took `seconds`."""
        self._recent_s.setdefault(name, deque(maxlen=_WINDOW)).append(seconds)
        self._total_s[name] = self._total_s.get(name, 0.0) + seconds
        self._count[name] = self._count.get(name, 0) + 1

    def status(self) -> tuple[StageStatus, ...]:
        """Return the totals since start and the quantiles of the recent runs."""
        rows = []
        for name, recent_s in self._recent_s.items():
            p50_ms, p95_ms = np.percentile(recent_s, (50, 95)) * 1e3
            rows.append(
                StageStatus(
                    name=name,
                    count=self._count[name],
                    total_s=self._total_s[name],
                    p50_ms=p50_ms,
                    p95_ms=p95_ms,
                )
            )
        return tuple(rows)
