"""A recording, read: its channels, what is known of it, and its records in the order of arrival."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, Self

from mcap.records import Message

from services.recorder.chunk import ChunkPlace, read
from services.recorder.contents import Contents, read_contents
from services.recorder.errors import BadRecording

PROFILE = "encircle"
FORMAT = "1"
MESSAGE_ENCODING = "msgpack"


class Record(NamedTuple):
    """A sample as it was received."""

    key: str
    payload: bytes
    log_ns: int
    """When it was received, wall clock of the recorder."""
    publish_ns: int
    """When it was sent, wall clock of the sender."""
    sequence: int
    """The sender's counter, modulo 2^32."""


class Channel(NamedTuple):
    """What was recorded under one key."""

    key: str
    schema_name: str
    schema: str
    """JSON Schema of the messages; empty for a key that is not in the topic table."""
    num_records: int


class RecordedLog:
    """Opens a recording, also one whose recorder was killed; `lost` says what could not be read.

    Close it, best by `with`. Memory is that of a few chunks; any number of iterators may be open.
    """

    def __init__(self, path: Path | str) -> None:
        """Open and read the tables.

        Raises:
            BadRecording: If it is no recording of ours, or nothing in it can be read.
            OSError: If the file cannot be opened.
        """
        self.path = Path(path)
        if self.path.is_dir():
            raise BadRecording(f"{path} is a folder; it must be a file that `record` has written")
        self._file = self.path.open("rb")
        try:
            self._contents = read_contents(self._file, self.path)
            self._check()
        except BaseException:
            self._file.close()
            raise
        # In the order of the file, which is that of time: its writer's clock never goes back.
        self._chunks: list[ChunkPlace] = self._contents.chunks
        self.lost = self._contents.lost
        """What was not readable, a sentence each; grows while damaged chunks are met."""

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """`encircle`: format and versions; `settings`; `end`: what was lost in recording."""
        return self._contents.metadata

    @property
    def channels(self) -> dict[str, Channel]:
        """What was recorded, by key."""
        found = {}
        for number, channel in self._contents.channels.items():
            schema = self._contents.schemas.get(channel.schema_id)
            name = "" if schema is None else schema.name
            text = "" if schema is None else schema.data.decode(errors="replace")
            count = self._contents.counts[number]
            found[channel.topic] = Channel(channel.topic, name, text, count)
        return found

    @property
    def start_ns(self) -> int:
        """When the first record was received; 0 if there is none."""
        return min((place.start_ns for place in self._chunks), default=0)

    @property
    def end_ns(self) -> int:
        """When the last record was received; 0 if there is none."""
        return max((place.end_ns for place in self._chunks), default=0)

    def __len__(self) -> int:
        """How many records there are."""
        return sum(self._contents.counts.values())

    def __iter__(self) -> Iterator[Record]:
        return self.records()

    def records(
        self,
        start_ns: int | None = None,
        end_ns: int | None = None,
        wanted: Callable[[str], bool] = lambda _: True,
    ) -> Iterator[Record]:
        """Yield records in the order in which they were received.

        Args:
            start_ns: the first time of interest. end_ns: the time before which to end.
            wanted: whether a key is; chunks that have none are not even read.
        """
        low = self.start_ns if start_ns is None else start_ns
        high = self.end_ns + 1 if end_ns is None else end_ns
        keys = {n: channel.topic for n, channel in self._contents.channels.items()}
        keys = {number: key for number, key in keys.items() if wanted(key)}
        for place in self._chunks:
            if place.end_ns < low or place.start_ns >= high:
                continue
            if place.channels is not None and place.channels.isdisjoint(keys):
                continue
            for message in self._messages(place):
                if message.channel_id in keys and low <= message.log_time < high:
                    yield Record(
                        keys[message.channel_id],
                        message.data,
                        message.log_time,
                        message.publish_time,
                        message.sequence,
                    )

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _messages(self, place: ChunkPlace) -> list[Message]:
        try:
            records = read(self._file, place)
        except BadRecording as error:
            if str(error) not in self.lost:
                self.lost.append(str(error))
            return []
        return [record for record in records if isinstance(record, Message)]

    def _check(self) -> None:
        contents: Contents = self._contents
        profile = contents.header.profile
        if profile != PROFILE:
            raise BadRecording(
                f"{self.path} is an MCAP file of profile {profile!r}, written by "
                f"{contents.header.library!r}; it must be {PROFILE!r}, as `encircle record` writes"
            )
        version = contents.metadata.get("encircle", {}).get("format", FORMAT)
        if version != FORMAT:
            raise BadRecording(
                f"{self.path} is of format {version!r}, and this encircle reads {FORMAT!r}: it is "
                "from another version; its metadata name which"
            )
