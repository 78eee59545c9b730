"""Messages to bytes and back: one msgpack map, its array written straight behind the header.

To every msgpack library the payload is an ordinary map whose last pair is `data`. We write that
pair's bytes behind the packed header and, on the way back, stop unpacking where they begin, so an
array is copied once when sent and not at all when decoded.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import msgpack
from pydantic import TypeAdapter, ValidationError

from schemas.message import ArrayMessage, Envelope, Message, MessageError

MAX_PAYLOAD_BYTES = 256 << 20
MAX_PLAIN_BYTES = 1 << 20  # A message without an array is small; 64 cameras' states are 20 kB.
MAX_HEADER_BYTES = 4096  # What stands before `data`; ours are below 700 bytes.
_DATA_KEY = b"\xa4data"
_LIMITS = {
    # msgpack allocates a container before it has read its items: without these caps nested
    # headers claim gigabytes from a message of a few bytes.
    "max_array_len": 4096,
    "max_map_len": 256,
    "max_str_len": 65536,
    "max_ext_len": 0,
}
_LENGTH_BYTES = {0xC4: 1, 0xC5: 2, 0xC6: 4}  # msgpack bin8, bin16, bin32.


class Encoded(NamedTuple):
    """A payload in two slices, so that the body can be copied straight into shared memory."""

    header: bytes
    body: bytes | bytearray | memoryview

    def __len__(self) -> int:
        return len(self.header) + len(self.body)

    def join(self) -> bytes:
        """Return the payload as one buffer (one copy of the body)."""
        return b"".join((self.header, self.body))


def encode(message: Message, envelope: Envelope) -> Encoded:
    """Pack a message under its envelope."""
    packer = msgpack.Packer(autoreset=False)
    fields = envelope.model_dump()
    if not isinstance(message, ArrayMessage):
        packer.pack(fields | message.model_dump())
        return Encoded(packer.bytes(), b"")
    fields |= message.model_dump(exclude={"data"})
    packer.pack_map_header(len(fields) + 1)
    for key, value in fields.items():
        packer.pack(key)
        packer.pack(value)
    body = message.data
    header = packer.bytes() + _DATA_KEY + b"\xc6" + len(body).to_bytes(4, "big")
    return Encoded(header, body)


def decode(adapter: TypeAdapter[Any], payload: bytes) -> tuple[Envelope, Any]:
    """Unpack and validate a payload; an array in it stays a view of `payload`.

    Raises:
        MessageError: For anything that is not a valid message of the adapter's type; nothing
            larger than the payload itself is allocated on the way.
    """
    fields = unpack(payload)
    try:
        return Envelope.model_validate(fields), adapter.validate_python(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "message"
        raise MessageError(f"{where}: {first['msg']}") from None


def unpack(payload: bytes) -> Mapping[str, Any]:
    """Read the map of a payload; `data`, when it stands last, is a memoryview into it.

    Raises:
        MessageError: If the payload is no such map, is cut short, or exceeds a bound.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise MessageError(f"payload of {len(payload)} bytes exceeds {MAX_PAYLOAD_BYTES}")
    view = memoryview(payload)
    unpacker, base = _unpacker(view), 0
    fields: dict[str, Any] = {}
    try:
        for _ in range(unpacker.read_map_header()):
            key = unpacker.unpack()
            if not isinstance(key, str):
                raise MessageError(f"key {key!r:.40} is not a string")
            if key in fields:
                raise MessageError(f"key {key!r:.40} stands twice")
            at = base + unpacker.tell()
            if key == "data" and at < len(view) and view[at] in _LENGTH_BYTES:
                fields[key], base = _bin(view, at)
                unpacker = _unpacker(view[base:])  # Ours ends here; other writers may go on.
            else:
                fields[key] = unpacker.unpack()
        end = base + unpacker.tell()
    except msgpack.OutOfData:
        return _unpack_whole(payload)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise _malformed(error) from None
    if end != len(view):
        raise MessageError(f"{len(view) - end} bytes follow the message")
    return fields


def _unpacker(view: memoryview) -> msgpack.Unpacker:
    unpacker = msgpack.Unpacker(max_buffer_size=MAX_HEADER_BYTES, **_LIMITS)
    unpacker.feed(view[:MAX_HEADER_BYTES])
    return unpacker


def _bin(view: memoryview, at: int) -> tuple[memoryview, int]:
    """The bytes of the msgpack bin that starts at `at`, and where it ends."""
    start = at + 1 + _LENGTH_BYTES[view[at]]
    length = int.from_bytes(view[at + 1 : start], "big")
    if start + length > len(view):
        raise MessageError(f"data claims {length} bytes, {len(view) - start} follow its header")
    return view[start : start + length], start + length


def _unpack_whole(payload: bytes) -> Mapping[str, Any]:
    """The slow way: a long plain message, or a writer that did not put `data` last."""
    if len(payload) > MAX_PLAIN_BYTES:
        raise MessageError(
            f"no `data` within the first {MAX_HEADER_BYTES} bytes of {len(payload)}: cut short, or "
            f"a plain message above {MAX_PLAIN_BYTES} bytes"
        )
    try:
        fields = msgpack.unpackb(payload, max_bin_len=len(payload), **_LIMITS)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise _malformed(error) from None
    if not isinstance(fields, dict) or not all(isinstance(key, str) for key in fields):
        raise MessageError("the payload is not a map with string keys")
    return fields


def _malformed(error: Exception) -> MessageError:
    if isinstance(error, MessageError):
        return error
    return MessageError(f"not msgpack: {type(error).__name__} {str(error)[:80]}".rstrip())
