"""`encircle echo`: what is said on a key, as it is said."""

import time
from collections import Counter

from schemas.codec import encode
from schemas.message import Envelope
from schemas.topics import Delivery, find
from services.inspector import plain
from services.inspector.description import Description, describe
from services.inspector.diagnosis import why_silent
from services.inspector.errors import UnknownField
from services.inspector.listening_service import Listening, Write, open_bus
from services.inspector.settings import EchoSettings
from services.inspector.witness_service import Witness
from services.runtime.bus import Bus
from services.runtime.errors import NoReply

MAX_ITEMS = 8
"""Of a list so many are printed, unless --full."""
SCREEN_HZ = 10.0
"""Nobody reads faster."""


def echo(settings: EchoSettings, out: Write, tell: Write, *, terminal: bool) -> int:
    """Print messages until enough were printed.

    Args:
        settings: What to print and how much of it.
        out: Takes lines of messages. tell: Takes lines about them.
        terminal: Whether somebody reads along.

    Returns:
        0, or 1 when nothing came.

    Raises:
        UnknownField: If a message has no such field.
    """
    targets = [plain.split_field(key) for key in settings.keys]
    printer = _Printer(settings, {field for _, field in targets} - {""}, out, tell, terminal)
    keys = tuple(key for key, _ in targets)
    with open_bus(settings.bus) as bus, Witness(bus, settings.bus) as witness:
        asked = [key for key in keys if _on_request(key)]
        for key in asked:
            printer.fetch(bus, key, witness)
        only_asked = len(asked) == len(keys)
        with Listening(bus, witness, settings, keys, tell) as listening:
            for sample in () if printer.done or only_asked else listening.samples():
                if sample is not None:
                    printer.take(sample.key, sample.payload)
                if printer.done:
                    break
            for key, num in sorted(listening.dropped.items()):
                tell(f"{key}: {num} were let go here, because printing is slower than they come")
    printer.say_skipped()
    return 0 if printer.num_printed else 1


def _on_request(key: str) -> bool:
    row = find(key)
    return row is not None and row.delivery is Delivery.QUERY


class _Printer:
    def __init__(
        self, settings: EchoSettings, fields: set[str], out: Write, tell: Write, terminal: bool
    ) -> None:
        if len(fields | ({settings.field} - {""})) > 1:
            raise UnknownField(f"fields {', '.join(sorted(fields))}: give one for all keys")
        self._settings = settings
        self._field = settings.field or "".join(fields)
        self._several_keys = len(settings.keys) > 1 or "*" in settings.keys[0]
        self._limit = 1 if settings.once else settings.num
        rate_hz = settings.rate
        if rate_hz is None:
            rate_hz = SCREEN_HZ if terminal and self._limit is None else 0.0
        self._min_gap_s = 1 / rate_hz if rate_hz else 0.0
        self._max_items = None if settings.full else MAX_ITEMS
        self._last_s: dict[str, float] = {}
        self._skipped: Counter[str] = Counter()
        self._out = out
        self._tell = tell
        self.num_printed = 0

    @property
    def done(self) -> bool:
        """Whether enough was printed."""
        return self._limit is not None and self.num_printed >= self._limit

    def take(self, key: str, payload: bytes) -> None:
        """Print a payload, or pass over it if its key has just been printed."""
        now_s = time.monotonic()
        if now_s - self._last_s.get(key, -1e9) < self._min_gap_s:
            self._skipped[key] += 1
            return
        self._last_s[key] = now_s
        self._print(describe(key, payload))

    def fetch(self, bus: Bus, key: str, witness: Witness) -> None:
        """Print what is sent on request only, or tell why there is no answer."""
        topic = find(key)
        assert topic is not None
        try:
            message = bus.fetch(topic)
        except NoReply as error:
            self._tell(str(error))
            for verdict in why_silent(witness.facts(), key):
                for line in verdict.lines():
                    self._tell(line)
            return
        # An answer's envelope is its sender's; what matters here is what it says.
        envelope = Envelope(seq=0, src=topic.sender, boot="request", t_pub_ns=time.time_ns())
        self._print(describe(key, encode(message, envelope).join()))

    def say_skipped(self) -> None:
        """Tell what was passed over."""
        for key, num in sorted(self._skipped.items()):
            self._tell(f"{key}: {num} more not printed (--rate 0 prints all)")

    def _print(self, said: Description) -> None:
        self.num_printed += 1
        if said.fault:
            self._tell(said.line)
        elif self._settings.json_:
            value = plain.select(said.fields, self._field)
            self._out(plain.as_json({"key": said.key, self._field or "message": value}))
        elif self._settings.line and not self._field:
            self._out(said.line)
        else:
            value = plain.select(said.fields, self._field)
            lines = plain.text(value, self._max_items)
            if self._field and len(lines) == 1:
                self._out(
                    f"{said.key}  {lines[0]}" if "*" in "".join(self._settings.keys) else lines[0]
                )
                return
            self._out(f"--- {said.key}")
            for line in lines:
                self._out(line)
