"""Raw samples as they were received, for those who keep or count them and need no meaning."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from typing import NamedTuple, Self

import zenoh

from services.runtime.bus import Bus
from services.runtime.key_filter import parse

MAX_BYTES = 256 << 20
_OVERHEAD_BYTES = 512  # What a waiting sample costs beside its payload.
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Sample(NamedTuple):
    """What came on a key."""

    key: str
    payload: bytes
    received_ns: int
    """Wall clock of the receiver."""
    published_ns: int | None
    """zenoh's own time stamp; None where the sender's session sets none."""


class Tap:
    """Takes in all that is published on some key expressions, valid or not, in order of arrival.

    Payloads are copied as they arrive, so that nobody's shared memory is held. What waits is
    bounded in bytes: beyond that the oldest is let go, and counted under its key.
    """

    def __init__(
        self,
        bus: Bus,
        expressions: Sequence[str],
        max_bytes: int = MAX_BYTES,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Start to listen.

        Args:
            bus: To listen on. expressions: Key expressions.
            max_bytes: What may wait. clock: Stamps what is received, ns.

        Raises:
            BadExpression: If an expression is none of zenoh's key expressions.
        """
        self._max_bytes = max_bytes
        self._clock = clock
        self._waiting: deque[Sample] = deque()
        self._num_bytes = 0
        self._dropped: Counter[str] = Counter()
        self._changed = threading.Condition()
        self._closed = False
        parsed = [parse(expression) for expression in dict.fromkeys(expressions)]
        with ExitStack() as stack:
            for index, expression in enumerate(parsed):
                stack.callback(bus.overhear(str(expression), self._put_unless(parsed[:index])))
            self._stop: Callable[[], None] = stack.pop_all().close

    def get(self, timeout_s: float | None = None) -> Sample:
        """Take the oldest sample.

        Raises:
            TimeoutError: If none came in time, or the tap was closed.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not self._waiting:
                left_s = None if deadline_s is None else deadline_s - time.monotonic()
                if self._closed or (left_s is not None and left_s <= 0):
                    raise TimeoutError(f"no sample within {timeout_s} s")
                self._changed.wait(left_s)
            sample = self._waiting.popleft()
            self._num_bytes -= _size(sample)
            return sample

    def add(self, sample: Sample) -> None:
        """Put in what has come another way, e.g. as an answer; once it is closed, nothing."""
        with self._changed:
            if self._closed:
                return
            self._waiting.append(sample)
            self._num_bytes += _size(sample)
            while self._num_bytes > self._max_bytes:
                oldest = self._waiting.popleft()
                self._num_bytes -= _size(oldest)
                self._dropped[oldest.key] += 1
            self._changed.notify()

    @property
    def dropped(self) -> dict[str, int]:
        """How many samples of each key were let go, because too much waited."""
        with self._changed:
            return dict(self._dropped)

    @property
    def waiting_bytes(self) -> int:
        """What waits to be taken."""
        return self._num_bytes

    def close(self) -> None:
        """Stop to listen; `get` still hands out what waits. Idempotent."""
        self._stop()
        with self._changed:
            self._closed = True  # What is still under way to `add` comes too late.
            self._changed.notify_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put_unless(self, others: Sequence[zenoh.KeyExpr]) -> Callable[[zenoh.Sample], None]:
        """Take over what matches none of `others`, by whose subscriptions it comes already."""

        def put(received: zenoh.Sample) -> None:
            key = received.key_expr
            if received.kind == zenoh.SampleKind.PUT and not any(o.includes(key) for o in others):
                self._put(received)

        return put

    def _put(self, received: zenoh.Sample) -> None:
        published_ns = None if received.timestamp is None else _ns(received.timestamp.get_time())
        payload = received.payload.to_bytes()
        self.add(Sample(str(received.key_expr), payload, self._clock(), published_ns))


def _size(sample: Sample) -> int:
    return len(sample.payload) + _OVERHEAD_BYTES


def _ns(moment: datetime) -> int:
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000
