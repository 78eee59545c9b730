"""Listening until enough was heard; silence is explained."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from services.inspector.diagnosis import why_silent
from services.inspector.expressions import rows_of
from services.inspector.settings import ListenSettings
from services.inspector.verdict import Verdict
from services.inspector.witness_service import Witness
from services.runtime.bus import Bus
from services.runtime.settings import BusSettings
from services.runtime.tap import Sample, Tap

Write = Callable[[str], None]

SILENT_S = 2.0
"""So long nothing may come before we say why."""
_AGAIN_S = 5.0
"""The reason is looked for again so often while nothing comes, and told when it has changed."""
_POLL_S = 0.1
_PERIODS = 10
"""A key that has been heard is silent when it stays away for so many periods."""


@contextmanager
def open_bus(settings: BusSettings) -> Iterator[Bus]:
    """Join the bus as one who only listens: nothing of ours needs shared memory."""
    with Bus(settings.model_copy(update={"shm_pool_mib": 0}), "inspector") as bus:
        yield bus


class Listening:
    """What comes on some keys; when nothing does, `tell` is told why."""

    def __init__(
        self,
        bus: Bus,
        witness: Witness,
        settings: ListenSettings,
        keys: tuple[str, ...],
        tell: Write,
    ) -> None:
        self._tap = Tap(bus, keys)
        self._witness = witness
        self._duration_s = settings.duration
        self._keys = keys
        self._tell = tell
        self._told: list[Verdict] = []
        self.num_heard = 0

    def samples(self) -> Iterator[Sample | None]:
        """Yield what comes, and None at least ten times a second; ends after the duration."""
        start_s = heard_s = asked_s = time.monotonic()
        end_s = start_s + (self._duration_s or float("inf"))
        while (now_s := time.monotonic()) < end_s:
            try:
                sample: Sample | None = self._tap.get(min(_POLL_S, end_s - now_s))
            except TimeoutError:
                sample = None
            if sample is not None:
                self.num_heard += 1
                heard_s = now_s
                self._told = []
            elif now_s - heard_s > self._patience_s() and now_s - asked_s > self._pause_s():
                self._explain()
                asked_s = time.monotonic()
            yield sample

    @property
    def dropped(self) -> dict[str, int]:
        """Samples of each key that we let go, because we were too slow."""
        return self._tap.dropped

    def close(self) -> None:
        """Stop to listen."""
        self._tap.close()

    def __enter__(self) -> "Listening":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _patience_s(self) -> float:
        if not self.num_heard:
            return SILENT_S
        rates = [row.rate_hz for key in self._keys for row in rows_of(key) if row.rate_hz]
        return max(SILENT_S, _PERIODS / max(rates, default=_PERIODS))

    def _pause_s(self) -> float:
        return _AGAIN_S if self._told else 0.0

    def _explain(self) -> None:
        facts = self._witness.facts()
        verdicts = [verdict for key in self._keys for verdict in why_silent(facts, key)]
        if verdicts != self._told:
            self._tell("nothing comes:")
            for verdict in dict.fromkeys(verdicts):
                for line in verdict.lines():
                    self._tell(line)
        self._told = verdicts
