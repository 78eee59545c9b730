"""What was said last before a time of the recording: of each key, and of the map."""

from collections.abc import Callable, Iterator

from schemas.codec import decode
from schemas.message import MessageError
from schemas.topics import MAP_CHANGES, MAP_FULL
from services.recorder.log_file import Record, RecordedLog
from services.recorder.map_state import MapState

MAP_KEYS = (MAP_CHANGES.key, MAP_FULL.key)
_NS = 1_000_000_000
_FRESH_NS = 2 * _NS
"""What was said longer ago is stale: heartbeats and latched messages come each second."""
_FIRST_WINDOW_NS = 10 * _NS
_AHEAD_NS = 5 * _NS
"""How far after a time a first snapshot may be to be good enough for it."""


class History:
    """Looks back from a time (ns) of a recording, at what is wanted of it."""

    def __init__(self, log: RecordedLog, wanted: Callable[[str], bool]) -> None:
        self._log, self._wanted = log, wanted

    def last_words(self, t_ns: int) -> list[Record]:
        """Return the newest record of each key before `t_ns`, the map's excepted, in order."""
        newest: dict[str, Record] = {}
        for record in self._log.records(t_ns - _FRESH_NS, t_ns, self._wanted):
            if record.key not in MAP_KEYS:
                newest.pop(record.key, None)
                newest[record.key] = record
        return list(newest.values())

    def map_at(self, t_ns: int, state: MapState) -> None:
        """Bring `state` to what was known of the map at `t_ns`, or to the first snapshot after."""
        state.forget()
        for record in self._map_records(t_ns):
            take(state, record)
        if not state.known:
            ahead = self._log.records(t_ns, t_ns + _AHEAD_NS, lambda key: key == MAP_FULL.key)
            for record in ahead:
                take(state, record)
                return

    def _map_records(self, t_ns: int) -> Iterator[Record]:
        """Yield what tells the map at `t_ns`: from the last two snapshots before it on."""
        window_ns = _FIRST_WINDOW_NS
        while True:
            low_ns = t_ns - window_ns
            times = [
                record.log_ns
                for record in self._log.records(low_ns, t_ns, lambda key: key == MAP_FULL.key)
            ]
            if len(times) > 1 or low_ns <= self._log.start_ns:
                break
            window_ns *= 2
        # A snapshot was asked for while changes went on: the last may be older than what was
        # told before it, and then the one before leads there.
        first_ns = times[-2] if len(times) > 1 else self._log.start_ns
        return self._log.records(first_ns, t_ns, lambda key: key in MAP_KEYS)


def take(state: MapState, record: Record) -> None:
    """Take a record of the map into a state; what is not valid is passed over."""
    topic = MAP_FULL if record.key == MAP_FULL.key else MAP_CHANGES
    try:
        envelope, message = decode(topic.adapter, record.payload)
    except MessageError:
        return
    state.take(message, envelope)
