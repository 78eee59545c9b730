"""One chunk of a recording: where it stands in the file, and what is in it."""

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import get_chunk_data_stream

from services.recorder.errors import BadRecording

MAX_BYTES = 1 << 30
"""Uncompressed. A chunk ends with the message that takes it past 8 MiB; a message has 256 MiB."""
_HEADER_BYTES = 9  # Opcode and length.
_MIN_BYTES = _HEADER_BYTES + 40  # Of a chunk with no data.
MALFORMED = (
    McapError, struct.error, ValueError, RuntimeError, OverflowError, MemoryError, EOFError,
)  # fmt: skip
"""What mcap, lz4 and zstandard raise over bytes that are not what they claim to be."""


@dataclass(frozen=True)
class ChunkPlace:
    """A chunk's place, and the times of its first and last message (ns)."""

    offset: int
    length: int
    """Bytes, with the record's header."""
    start_ns: int
    end_ns: int
    channels: frozenset[int] | None = None
    """Whose messages it has; None: nobody has noted."""


def read(file: IO[bytes], place: ChunkPlace) -> list[McapRecord]:
    """Read the schemas, channels and messages of a chunk.

    Raises:
        BadRecording: If its bytes are not what its check sum says, or no chunk.
    """
    file.seek(place.offset)
    data = file.read(place.length)
    try:
        if len(data) < max(_MIN_BYTES, place.length) or data[0] != Opcode.CHUNK:
            raise BadRecording(f"no chunk of {place.length} bytes at byte {place.offset}")
        return list(unpack(data[_HEADER_BYTES:]))
    except MALFORMED as error:
        where = f"bytes {place.offset}..{place.offset + place.length}"
        raise BadRecording(f"{where} are damaged: {str(error)[:200]}") from None


def unpack(data: bytes) -> Iterator[McapRecord]:
    """Unpack the content of a chunk's record.

    Raises:
        Any of `MALFORMED`.
    """
    chunk = Chunk.read(ReadDataStream(io.BytesIO(data)))
    if chunk.uncompressed_size > MAX_BYTES:
        raise ValueError(f"it claims {chunk.uncompressed_size} bytes; {MAX_BYTES} at most")
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    while stream.count < length:
        opcode, size = stream.read1(), stream.read8()
        end = stream.count + size
        if end > length:
            raise ValueError(f"a record of {size} bytes where {length - stream.count} are left")
        match opcode:
            case Opcode.MESSAGE:
                yield Message.read(stream, size)
            case Opcode.CHANNEL:
                yield Channel.read(stream)
            case Opcode.SCHEMA:
                yield Schema.read(stream)
        if stream.count < end:
            stream.read(end - stream.count)
