"""A message as plain data, a part of it, and either as text one can read."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from schemas.message import ArrayMessage, Envelope, Message
from services.inspector.arrays import array_words
from services.inspector.errors import UnknownField

_STEP = re.compile(r"\[(\d+)\]|\.?([^.\[\]]+)")


def plain(envelope: Envelope, message: Message) -> dict[str, Any]:
    """Return a message's fields under its envelope's; an array is described, not shown."""
    fields = envelope.model_dump() | message.model_dump(exclude={"data"})
    if isinstance(message, ArrayMessage):
        fields["data"] = array_words(message)
    return fields


def split_field(target: str) -> tuple[str, str]:
    """Part `cams/0/pose.pose.position` into the key and the field; keys have no dots."""
    head, slash, last = target.rpartition("/")
    name, _, path = last.partition(".")
    return head + slash + name, path


def select(fields: Any, path: str) -> Any:
    """Return the part of plain data that a path like `topics[0].rate_hz` names.

    Raises:
        UnknownField: If there is none; the text names those that there are.
    """
    value, walked = fields, ""
    for match in _STEP.finditer(path):
        step = match[1] if match[1] is not None else match[2]
        value = _member(value, step, path, walked)
        walked += match[0]
    if _STEP.sub("", path):
        raise UnknownField(f"field {path!r}: write it like pose.position or topics[0].rate_hz")
    return value


def text(value: Any, max_items: int | None) -> list[str]:
    """Write plain data as lines, one per field, indented as it is nested.

    Args:
        value: Of `plain` or `select`.
        max_items: Of a long list only so many are written, then how many follow; None for all.
    """
    return list(_lines(value, 0, max_items)) if _nested(value) else [_flat(value, max_items)]


def as_json(value: Any) -> str:
    """Write plain data as one line of JSON; bytes as their number."""
    return json.dumps(value, default=_unknown, separators=(",", ":"))


def _member(value: Any, step: str, path: str, walked: str) -> Any:
    if isinstance(value, Mapping):
        if step in value:
            return value[step]
        known = ", ".join(str(name) for name in value)
    elif isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        if step.isdigit() and int(step) < len(value):
            return value[int(step)]
        known = f"0 to {len(value) - 1}" if value else "nothing, it is empty"
    else:
        known = "nothing, it is a single value"
    where = f" of {walked.lstrip('.')}" if walked else ""
    raise UnknownField(f"field {path!r}: no {step!r}{where}; known: {known}")


def _lines(value: Any, depth: int, max_items: int | None) -> Iterator[str]:
    pad = "  " * depth
    if isinstance(value, Mapping):
        for name, part in value.items():
            if _nested(part):
                yield f"{pad}{name}:"
                yield from _lines(part, depth + 1, max_items)
            else:
                yield f"{pad}{name}: {_flat(part, max_items)}"
        return
    shown = value if max_items is None else value[:max_items]
    for part in shown:
        if _nested(part):
            first, *rest = _lines(part, depth + 1, max_items)
            yield f"{pad}- {first.strip()}"
            yield from rest
        else:
            yield f"{pad}- {_flat(part, max_items)}"
    if len(shown) < len(value):
        yield f"{pad}... {len(value) - len(shown)} more (--full shows all)"


def _nested(value: Any) -> bool:
    if isinstance(value, Mapping):
        return bool(value)
    return isinstance(value, (list, tuple)) and any(
        isinstance(part, (Mapping, list, tuple)) for part in value
    )


def _flat(value: Any, max_items: int | None) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (bytes, bytearray, memoryview)):
        return _unknown(value)
    if isinstance(value, (list, tuple)):
        shown = value if max_items is None else value[:max_items]
        more = f", ... {len(value) - len(shown)} more" if len(shown) < len(value) else ""
        return f"[{', '.join(_flat(part, max_items) for part in shown)}{more}]"
    return "none" if value is None else str(value)


def _unknown(value: Any) -> str:
    if isinstance(value, (bytes, bytearray, memoryview)):
        return f"{len(value)} bytes"
    return f"{type(value).__name__} {value!s:.80}"
