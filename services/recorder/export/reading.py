"""How recordings are gone through: the parts that matter, by the clock of what was measured."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from schemas.topics import Topic, find
from services.recorder.export.decoded import Decoded, Decoder
from services.recorder.export.errors import ExportError
from services.recorder.export.moment import Moment, moments
from services.recorder.export.timeline import Timeline
from services.recorder.log_file import RecordedLog


class Reading:
    """One recording, to be gone through as often as one likes."""

    def __init__(self, log: RecordedLog) -> None:
        """Look at what was recorded.

        Raises:
            ExportError: If it has no clock.
        """
        self._log = log
        self.decoder = Decoder()
        self.keys = frozenset(log.channels)
        self.clock = Timeline(self.keys).clock

    def ticks(self) -> list[tuple[int, float]]:
        """Return tick and time, s since the first, of every instant.

        Raises:
            ExportError: If there is none.
        """
        timeline, found = Timeline(self.keys), []
        for said in Decoder().messages(self._log.records(wanted=lambda key: key == self.clock)):
            timeline.advance(said.message.t_ns)
            found.append((said.message.tick, timeline.elapsed_s(said.message.t_ns)))
        if not found:
            raise ExportError(f"nothing that can be read was recorded under {self.clock}")
        return found

    def messages(self, topics: Iterable[Topic[Any]]) -> Iterator[Decoded]:
        """Yield the messages of some topics, and of the clock."""
        return self.decoder.messages(self._log.records(wanted=self._wants(topics)))

    def moments(self, topics: Iterable[Topic[Any]], times_s: Iterable[float]) -> Iterator[Moment]:
        """Yield what was known at ascending times, s since the first instant."""
        return moments(self.messages(topics), Timeline(self.keys), times_s)

    def require(self, topic: Topic[Any], what: str) -> None:
        """See to it that a topic was recorded.

        Raises:
            ExportError: If not; naming what was.
        """
        if not any(find(key) is topic for key in self.keys):
            raise ExportError(
                f"{what} needs {topic.key}, which was not recorded; recorded: "
                f"{', '.join(sorted(self.keys)) or 'nothing'}"
            )

    def _wants(self, topics: Iterable[Topic[Any]]) -> Callable[[str], bool]:
        wanted = list(topics)
        return lambda key: key == self.clock or any(find(key) is topic for topic in wanted)
