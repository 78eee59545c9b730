"""`encircle hz`, `bw` and `delay`: how often, how much, how late."""

import time
from collections.abc import Callable
from enum import Enum

from schemas.codec import unpack
from schemas.message import MessageError
from schemas.topics import find
from services.inspector import plain
from services.inspector.delays import Delays
from services.inspector.header import Header, read_header
from services.inspector.listening_service import Listening, Write, open_bus
from services.inspector.rate_table import KeyFigures, bw_lines, delay_lines, hz_lines
from services.inspector.rates import KeyRate, as_plain
from services.inspector.settings import RateSettings
from services.inspector.witness_service import Witness
from services.runtime.tap import Sample

PERIOD_S = 1.0
"""Between two reports."""
_OF_THEN = "a replay is alive: rates are its own, stamps and delays those of the recording"
MAX_KEYS = 4096
"""More keys than these are not told apart."""


class Measure(Enum):
    """What is measured."""

    HZ = "hz"
    BW = "bw"
    DELAY = "delay"


_LINES: dict[Measure, Callable[[list[KeyFigures], int], list[str]]] = {
    Measure.HZ: hz_lines,
    Measure.BW: bw_lines,
    Measure.DELAY: delay_lines,
}


def measure(settings: RateSettings, what: Measure, out: Write, tell: Write) -> int:
    """Print a report once a second, and the last at the end.

    Returns:
        0, or 1 when nothing came.
    """
    counts = _Counts(settings.window, with_shutter=what is Measure.DELAY)
    with open_bus(settings.bus) as bus, Witness(bus, settings.bus) as witness:
        bus.presence.watch("replay", lambda _, alive: tell(_OF_THEN) if alive else None)
        with Listening(bus, witness, settings, settings.keys, tell) as listening:
            due_s = time.monotonic() + PERIOD_S
            for sample in listening.samples():
                if sample is not None:
                    counts.add(sample)
                if (now_s := time.monotonic()) >= due_s:
                    due_s = now_s + PERIOD_S
                    _report(settings, what, counts.figures(listening.dropped), out)
            if due_s - time.monotonic() < PERIOD_S / 2:  # Else the last report has just been.
                _report(settings, what, counts.figures(listening.dropped), out)
        return 0 if listening.num_heard else 1


def _report(settings: RateSettings, what: Measure, figures: list[KeyFigures], out: Write) -> None:
    now_ns = time.time_ns()
    if not figures:
        return
    if not settings.json_:
        for line in _LINES[what](figures, now_ns):
            out(line)
        out("")
        return
    for each in figures:
        row = as_plain(each.key, each.rate, now_ns, each.declared_hz, each.here)
        told = each.delays.told()
        delays = {} if told is None else {"delay": told._asdict()}
        out(plain.as_json({"t_ns": now_ns, **row, **delays}))


class _Counts:
    """Counts by key, from headers alone."""

    def __init__(self, window_s: float, *, with_shutter: bool) -> None:
        self._window_s = window_s
        self._with_shutter = with_shutter
        self._keys: dict[str, tuple[KeyRate, Delays]] = {}

    def add(self, sample: Sample) -> None:
        """Count a sample."""
        if sample.key not in self._keys and len(self._keys) >= MAX_KEYS:
            return
        rate, delays = self._keys.setdefault(sample.key, (KeyRate(self._window_s), Delays()))
        header = _header(sample.payload)
        rate.add(header, len(sample.payload), sample.received_ns)
        if header is not None:
            delays.add(sample.received_ns, header.t_pub_ns, self._shutter_ns(sample))

    def figures(self, dropped: dict[str, int]) -> list[KeyFigures]:
        """All keys in order."""
        return [
            KeyFigures(key, *counts, dropped.get(key, 0))
            for key, counts in sorted(self._keys.items())
        ]

    def _shutter_ns(self, sample: Sample) -> int | None:
        topic = find(sample.key) if self._with_shutter else None
        if topic is None or not topic.shared_memory:
            return None
        try:
            t_ns = unpack(sample.payload).get("t_capture_ns")
        except MessageError:
            return None
        return t_ns if isinstance(t_ns, int) else None


def _header(payload: bytes) -> Header | None:
    try:
        return read_header(payload)
    except MessageError:
        return None
