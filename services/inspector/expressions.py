"""Key expressions: which keys and which rows of the topic table they mean."""

import difflib
from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Any

from schemas.topics import TOPICS, Topic, find


def meets(one: str, other: str) -> bool:
    """Whether two key expressions have a key in common; `*` is one part, `**` any number.

    Source: zenoh's key expressions, https://zenoh.io/docs/manual/abstractions/.
    """
    return _meet(one.split("/"), other.split("/"))


def rows_of(expression: str) -> tuple[Topic[Any], ...]:
    """Return the rows of the topic table that an expression can mean."""
    if "*" not in expression:
        row = find(expression)
        return () if row is None else (row,)
    return tuple(topic for topic in TOPICS if meets(expression, topic.expression()))


def readable(topic: Topic[Any]) -> str:
    """Return a row's key as the README writes it."""
    return topic.key.replace("{camera}", "<i>").replace("{service}", "<service>[/<i>]")


def nearest(expression: str, keys: Iterable[str] = ()) -> str | None:
    """Return the key that was perhaps meant: one that exists, or one of the table's."""
    parts = expression.split("/")
    camera = parts[1] if len(parts) > 2 and parts[1].isdigit() else "0"
    known = [topic.key.format(camera=camera, service="mapper") for topic in TOPICS]
    found = difflib.get_close_matches(expression, [*keys, *known], 1, 0.6)
    return found[0] if found else None


def _meet(one: list[str], other: list[str]) -> bool:
    if not one or not other:
        return all(part == "**" for part in (*one, *other))
    if one[0] == "**":
        return _meet(one[1:], other) or _meet(one, other[1:])
    if other[0] == "**":
        return _meet(one, other[1:]) or _meet(one[1:], other)
    return _same(one[0], other[0]) and _meet(one[1:], other[1:])


def _same(one: str, other: str) -> bool:
    if "*" in (one, other) or one == other:
        return True
    # `$*` is any run of characters within a part; two such parts are taken to meet.
    if "$*" in one and "$*" in other:
        return True
    pattern, text = (one, other) if "$*" in one else (other, one)
    return "$*" in pattern and fnmatchcase(text, pattern.replace("$*", "*"))
