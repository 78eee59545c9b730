"""What came on a key, whoever sent it: valid, foreign or broken."""

from dataclasses import dataclass
from typing import Any

from schemas.codec import decode, unpack
from schemas.message import Envelope, Message, MessageError
from schemas.topics import camera_of, find
from services.inspector.arrays import size
from services.inspector.plain import plain
from services.inspector.summary import one_line

_SHOWN_BYTES = 16


@dataclass(frozen=True)
class Description:
    """A payload, understood as far as can be."""

    key: str
    fields: dict[str, Any]
    """Plain data; arrays are described."""
    line: str
    envelope: Envelope | None = None
    message: Message | None = None
    fault: str = ""
    """Why services refuse it; empty when they accept it, or when the key is not in the table."""


def describe(key: str, payload: bytes) -> Description:
    """Describe a payload; never fails, whatever the bytes are."""
    topic = find(key)
    if topic is None:
        return _foreign(key, payload)
    try:
        envelope, message = decode(topic.adapter, payload)
    except MessageError as error:
        return _broken(key, payload, str(error))
    camera = camera_of(key)
    if camera is not None and message.camera != camera:
        return _broken(key, payload, f"camera is {message.camera}; the key says {camera}")
    line = f"{key}  #{envelope.seq}  {one_line(message)}"
    return Description(key, plain(envelope, message), line, envelope, message)


def _broken(key: str, payload: bytes, reason: str) -> Description:
    line = f"{key}  refused by all services: {reason}"
    fields = {"fault": reason, **_raw(payload)}
    return Description(key, fields, line, fault=reason)


def _foreign(key: str, payload: bytes) -> Description:
    """A key that is not in the topic table: told as msgpack if it is that."""
    fields = _raw(payload)
    words = ", ".join(fields["fields"]) if "fields" in fields else fields["bytes"]
    return Description(key, fields, f"{key}  not in the topic table: {words}"[:300])


def _raw(payload: bytes) -> dict[str, Any]:
    try:
        return {"fields": dict(unpack(payload))}
    except MessageError:
        start = payload[:_SHOWN_BYTES].hex(" ")
        more = " ..." if len(payload) > _SHOWN_BYTES else ""
        return {"bytes": f"{size(len(payload))}: {start}{more}"}
