"""A recording, written: one channel per key, small chunks, nothing that a kill could undo."""

import json
import platform
import subprocess
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from schemas.codec import unpack
from schemas.message import Envelope, MessageError
from schemas.topics import find
from services.recorder.log_file import FORMAT, MESSAGE_ENCODING, PROFILE
from services.recorder.message_schema import json_schema, schema_name
from services.recorder.steady_file import SteadyFile
from services.runtime.meter import MAX_KEY_LENGTH
from services.runtime.tap import Sample

_CHUNK_BYTES = 8 << 20
"""Small enough to be written at once; smaller ones are many, and the summary at the end takes time
for each: hours of recording must be closed within seconds. A kill loses no more by it, for `flush`
ends a chunk too."""
MAX_KEYS = 4096
"""More are nobody's topics; MCAP numbers its channels with 16 bits."""
_MODULO = 1 << 32
"""MCAP's sequence numbers have 32 bits."""
_GIT_TIMEOUT_S = 2.0


class LogWriter:
    """Appends samples; whatever was before the last `flush` outlives the process."""

    def __init__(self, path: Path, settings: Mapping[str, str], *, overwrite: bool = False) -> None:
        """Create the file and say in it what it is.

        Args:
            path: the file. settings: what is to be known of the recording, as metadata.
            overwrite: take the place of a file that is there.

        Raises:
            CannotRecord: If it cannot be written.
        """
        self.path = path
        self._file = SteadyFile(path, overwrite=overwrite)
        stream = cast(IO[bytes], self._file)
        self._writer: Any = Writer(stream, _CHUNK_BYTES, CompressionType.LZ4)
        self._writer.start(PROFILE, f"encircle {version('encircle')}")
        self._writer.add_metadata("encircle", versions())
        self._writer.add_metadata("settings", dict(settings))
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._newest_ns = 0
        self.num_records = 0

    def takes(self, key: str) -> bool:
        """Whether there is room for a key: it is of a topic's length, and not one of too many."""
        known = len(self._channels)
        return key in self._channels or (len(key) <= MAX_KEY_LENGTH and known < MAX_KEYS)

    def write(self, sample: Sample) -> Envelope | None:
        """Append a sample; return its envelope, if it has one.

        A time of receipt is never before the last: whoever reads needs not sort.
        """
        envelope = _envelope(sample.payload)
        self._newest_ns = max(self._newest_ns, sample.received_ns)
        sent_ns = sample.published_ns
        if sent_ns is None:
            sent_ns = sample.received_ns if envelope is None else envelope.t_pub_ns
        self._writer.add_message(
            self._channel(sample.key),
            log_time=self._newest_ns,
            data=sample.payload,
            publish_time=sent_ns,
            sequence=0 if envelope is None else envelope.seq % _MODULO,
        )
        self.num_records += 1
        return envelope

    def flush(self) -> None:
        """Hand all that was written to the operating system."""
        self._writer.flush()

    @property
    def held_up(self) -> str:
        """Why the disk does not take what was written; empty when it does."""
        return self._file.error if self._file.held_up else ""

    @property
    def num_bytes(self) -> int:
        """Length of the file."""
        return self._file.tell()

    def close(self, end: Mapping[str, str]) -> int:
        """Write what was lost in recording, the summary, and close.

        Returns:
            How many bytes the disk did not take. 0: the file is whole.
        """
        self._writer.flush()
        self._writer.add_metadata("end", dict(end))
        self._writer.finish()
        return self._file.close()

    def _channel(self, key: str) -> int:
        channel = self._channels.get(key)
        if channel is None:
            channel = int(self._writer.register_channel(key, MESSAGE_ENCODING, self._schema(key)))
            self._channels[key] = channel
        return channel

    def _schema(self, key: str) -> int:
        topic = find(key)
        if topic is None:
            return 0  # MCAP's "no schema".
        name = schema_name(topic)
        if name not in self._schemas:
            text = json_schema(topic).encode()
            self._schemas[name] = int(self._writer.register_schema(name, "jsonschema", text))
        return self._schemas[name]


def versions() -> dict[str, str]:
    """Return what wrote a recording."""
    return {
        "format": FORMAT,
        "encircle": version("encircle"),
        "git": _revision(),
        "zenoh": version("eclipse-zenoh"),
        "mcap": version("mcap"),
        "python": platform.python_version(),
        "host": platform.node(),
        "created_ns": str(time.time_ns()),
    }


def as_metadata(values: Mapping[str, object]) -> dict[str, str]:
    """Return settings as MCAP has them: strings, of which those that are not are JSON."""
    return {
        name: value if isinstance(value, str) else json.dumps(value, default=str)
        for name, value in values.items()
    }


def _revision() -> str:
    """Return git's word on the code at hand; empty when it is installed and no checkout."""
    here = Path(__file__).parent
    try:
        done = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--dirty"],
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


def _envelope(payload: bytes) -> Envelope | None:
    try:
        return Envelope.model_validate(unpack(payload))
    except (MessageError, ValueError):
        return None
