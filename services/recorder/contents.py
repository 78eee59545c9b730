"""What a recording holds: from its summary, or, where its end is torn off, from all that is left.

A recorder that was killed leaves a file without its summary, on which indexed readers fail. Its
chunks are whole but for the last, so they are looked through in order instead.
"""

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Header, McapRecord, Message, Metadata, Schema

from services.recorder.chunk import MALFORMED, ChunkPlace, read
from services.recorder.errors import BadRecording

_MAGIC = b"\x89MCAP0\r\n"
_END = struct.Struct("<BQQQI8s")  # The footer, with its check sum last, and the magic.
_RECORD = struct.Struct("<BQ")  # Opcode and length.
_NO_OPCODE = 0  # What a file has where a power cut left holes.


@dataclass
class Contents:
    """Tables of what a file has."""

    header: Header
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    """Messages per channel."""
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    lost: list[str] = field(default_factory=list)
    """What could not be read, a sentence each."""

    def note(self, record: McapRecord) -> None:
        """Take a schema, channel or metadata into the tables."""
        match record:
            case Schema():
                self.schemas[record.id] = record
            case Channel():
                self.channels[record.id] = record
            case Metadata():
                self.metadata[record.name] = record.metadata


def read_contents(file: IO[bytes], path: Path) -> Contents:
    """Read what is in a file.

    Raises:
        BadRecording: If it is no MCAP file at all.
    """
    header = _header(file, path)
    size = path.stat().st_size
    try:
        return _from_summary(file, header, size)
    except MALFORMED:
        return _from_chunks(file, header, size)


def _header(file: IO[bytes], path: Path) -> Header:
    file.seek(0)
    if (magic := file.read(len(_MAGIC))) != _MAGIC:
        what = "is empty" if not magic else f"begins with {magic!r}"
        raise BadRecording(f"{path} {what}: no MCAP file")
    try:
        stream = ReadDataStream(file)
        if stream.read1() != Opcode.HEADER or stream.read8() > path.stat().st_size:
            raise ValueError("its first record is another")
        header: Header = Header.read(stream)
        return header
    except MALFORMED as error:
        raise BadRecording(f"{path} has no MCAP header: {error}") from None


def _from_summary(file: IO[bytes], header: Header, size: int) -> Contents:
    """Read the tables at the end.

    Raises:
        Any of `MALFORMED`: If they are missing or damaged.
    """
    _check_summary(file, size)
    file.seek(0)
    reader = SeekingReader(file)
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        raise ValueError("no summary")
    contents = Contents(header, summary.schemas, summary.channels)
    contents.counts.update(summary.statistics.channel_message_counts)
    offsets = [index.chunk_start_offset + index.chunk_length for index in summary.chunk_indexes]
    offsets += [index.offset + index.length for index in summary.metadata_indexes]
    if max(offsets, default=0) > size:
        raise ValueError("the summary points beyond the file")
    for metadata in reader.iter_metadata():
        contents.note(metadata)
    contents.chunks = [
        ChunkPlace(
            index.chunk_start_offset,
            index.chunk_length,
            index.message_start_time,
            index.message_end_time,
            frozenset(index.message_index_offsets) or None,
        )
        for index in summary.chunk_indexes
    ]
    return contents


def _check_summary(file: IO[bytes], size: int) -> None:
    """Hold the summary against its check sum, before anything in it is believed."""
    file.seek(max(0, size - _END.size))
    opcode, length, start, _, checksum, magic = _END.unpack(file.read())
    if (opcode, length, magic) != (Opcode.FOOTER, 20, _MAGIC) or not 0 < start < size:
        raise ValueError("no footer")
    file.seek(start)
    if zlib.crc32(file.read(size - start - 4 - len(_MAGIC))) != checksum:
        raise ValueError("the summary is damaged")


def _from_chunks(file: IO[bytes], header: Header, size: int) -> Contents:
    """Go through the records as far as they are whole."""
    contents, offset = Contents(header), len(_MAGIC)
    while offset + _RECORD.size <= size:
        file.seek(offset)
        opcode, length = _RECORD.unpack(file.read(_RECORD.size))
        end = offset + _RECORD.size + length
        if opcode == _NO_OPCODE or end > size:
            break
        if opcode == Opcode.DATA_END:
            contents.lost.append("the summary at the end is damaged; nothing else is missing")
            return contents
        _note(file, contents, opcode, ChunkPlace(offset, end - offset, 0, 0))
        offset = end
    contents.lost.append(
        f"the end is torn off: its recorder was killed, or the file was cut; {size - offset} bytes "
        "after the last whole record are not readable"
    )
    return contents


def _note(file: IO[bytes], contents: Contents, opcode: int, place: ChunkPlace) -> None:
    try:
        match opcode:
            case Opcode.CHUNK:
                times: list[int] = []
                channels: Counter[int] = Counter()
                for record in read(file, place):
                    contents.note(record)
                    if isinstance(record, Message):
                        times.append(record.log_time)
                        channels[record.channel_id] += 1
                if times:
                    contents.counts += channels
                    contents.chunks.append(
                        replace(
                            place,
                            start_ns=min(times),
                            end_ns=max(times),
                            channels=frozenset(channels),
                        )
                    )
            case Opcode.METADATA:
                contents.note(Metadata.read(ReadDataStream(file)))
    except BadRecording as error:
        contents.lost.append(str(error))
    except MALFORMED as error:
        contents.lost.append(f"metadata at byte {place.offset} are damaged: {error}")
