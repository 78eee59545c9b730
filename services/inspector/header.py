"""The envelope of a payload, read without its body: what rates and delays are made of."""

from typing import Any, NamedTuple

import msgpack
from pydantic import ValidationError

from schemas.codec import unpack
from schemas.message import Envelope, MessageError

_READ_BYTES = 512  # The envelope comes first and takes about 80; a long `src` fits too.
_WANTED = ("v", "seq", "src", "boot", "t_pub_ns")


class Header(NamedTuple):
    """Who sent it, the how-manieth on its key, and when."""

    seq: int
    src: str
    boot: str
    t_pub_ns: int


def read_header(payload: bytes) -> Header:
    """Read the envelope that a payload begins with; 8 us however long the payload is.

    A writer in another language may put the envelope elsewhere: then the whole is unpacked.

    Raises:
        MessageError: If there is no valid envelope.
    """
    fields = _first_fields(payload) or unpack(payload)
    try:
        envelope = Envelope.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise MessageError(f"{first['loc'][0]}: {first['msg']}") from None
    return Header(envelope.seq, envelope.src, envelope.boot, envelope.t_pub_ns)


def _first_fields(payload: bytes) -> dict[str, Any] | None:
    """The envelope's fields when they are the first of the map; None when they are not."""
    unpacker = msgpack.Unpacker(max_buffer_size=_READ_BYTES, max_str_len=256, max_bin_len=0)
    unpacker.feed(payload[:_READ_BYTES])
    fields: dict[str, Any] = {}
    try:
        if unpacker.read_map_header() < len(_WANTED):
            return None
        for _ in _WANTED:
            key = unpacker.unpack()
            if key not in _WANTED:
                return None
            fields[key] = unpacker.unpack()
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None
    return fields if len(fields) == len(_WANTED) else None
