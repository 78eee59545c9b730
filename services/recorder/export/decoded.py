"""What a recording's bytes mean."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from schemas.codec import decode
from schemas.message import Message, MessageError
from schemas.topics import Topic, camera_of, find
from services.recorder.log_file import Record


class Decoded(NamedTuple):
    """A message and how it came."""

    key: str
    topic: Topic[Any]
    camera: int | None
    """Index in the key, if it has one."""
    message: Message
    boot: str
    """The process that sent it."""
    publish_ns: int
    """Wall clock of the sender."""


class Decoder:
    """Reads records; what is none of our messages is left out and counted."""

    def __init__(self) -> None:
        self.bad: Counter[str] = Counter()
        """Messages that were refused, by key."""

    def messages(self, records: Iterable[Record]) -> Iterator[Decoded]:
        """Yield the messages of the topic table in the records' order."""
        for record in records:
            topic = find(record.key)
            if topic is None:
                continue
            try:
                envelope, message = decode(topic.adapter, record.payload)
            except MessageError:
                self.bad[record.key] += 1
                continue
            yield Decoded(
                record.key,
                topic,
                camera_of(record.key),
                message,
                envelope.boot,
                envelope.t_pub_ns,
            )
