"""Which record is due when: a recording's time against ours, with pause, seek, rate and loop."""

from collections.abc import Callable, Iterator

from services.recorder.errors import RecorderError
from services.recorder.log_file import Record, RecordedLog

_NS = 1_000_000_000


class Playback:
    """Hands out the records of a recording one by one, each at its time; never reads a clock.

    Times given to it are seconds of any clock that does not go back.
    """

    def __init__(
        self,
        log: RecordedLog,
        wanted: Callable[[str], bool] = lambda _: True,
        rate: float = 1.0,
        *,
        loop: bool = False,
    ) -> None:
        self._log, self._wanted = log, wanted
        self.rate, self.loop = rate, loop
        self.paused = True
        self._records: Iterator[Record] = iter(())
        self._next: Record | None = None
        self._position_ns = log.start_ns
        """Where we were at `_since_s`."""
        self._since_s = 0.0
        self.seek(0.0, 0.0)

    @property
    def duration_s(self) -> float:
        """Length of the recording."""
        return (self._log.end_ns - self._log.start_ns) / _NS

    @property
    def ended(self) -> bool:
        """Whether the last record has been taken."""
        return self._next is None

    def position_s(self, now_s: float) -> float:
        """Return how far we are from the recording's beginning."""
        if self.ended:
            return self.duration_s
        return min((self._now_ns(now_s) - self._log.start_ns) / _NS, self.duration_s)

    def pause(self, now_s: float) -> None:
        """Stand still."""
        self._anchor(now_s)
        self.paused = True

    def resume(self, now_s: float) -> None:
        """Go on; at the end, from the beginning."""
        if self.ended:
            self.seek(0.0, now_s)
        self._anchor(now_s)  # Also while it plays: going on changes nothing then.
        self.paused = False

    def set_rate(self, rate: float, now_s: float) -> None:
        """Go on faster or slower."""
        self._anchor(now_s)
        self.rate = rate

    def seek(self, t_s: float, now_s: float) -> None:
        """Go to a time of the recording, seconds from its beginning.

        Raises:
            RecorderError: If the recording does not reach so far.
        """
        if not 0.0 <= t_s <= self.duration_s:
            raise RecorderError(f"t_s {t_s:g} must be 0..{self.duration_s:.3f}, the recording's")
        self._position_ns, self._since_s = self._log.start_ns + round(t_s * _NS), now_s
        self._records = self._log.records(self._position_ns, wanted=self._wanted)
        self._next = next(self._records, None)

    def take(self, now_s: float) -> Record | None:
        """Return the next record if it is due."""
        record = self._next
        if record is None or self.paused or record.log_ns > self._now_ns(now_s):
            return None
        self._next = next(self._records, None)
        return record

    def wait_s(self, now_s: float) -> float | None:
        """Return how long the next record is to be waited for; None: for ever."""
        if self._next is None or self.paused:
            return None
        return max(0.0, (self._next.log_ns - self._now_ns(now_s)) / _NS / self.rate)

    def _anchor(self, now_s: float) -> None:
        self._position_ns, self._since_s = self._now_ns(now_s), now_s

    def _now_ns(self, now_s: float) -> int:
        if self.paused:
            return self._position_ns
        return self._position_ns + round((now_s - self._since_s) * self.rate * _NS)
