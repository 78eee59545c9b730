"""Which keys there are: declared by the topic table, told by heartbeats, heard by ourselves."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from schemas.topics import TOPICS, Delivery, Topic, find
from services.inspector.arrays import size
from services.inspector.expressions import meets, readable, rows_of
from services.inspector.facts import Facts, address_of
from services.inspector.rates import KeyRate
from services.inspector.tables import columns


class Row(NamedTuple):
    """One key, or a row of the table of which no key is known."""

    key: str
    message: str
    declared_hz: float | None
    rate_hz: float | None
    mean_bytes: float | None
    sender: str
    state: str
    """What one should know of it."""

    def plain(self) -> dict[str, Any]:
        """For machines."""
        return self._asdict()


def inventory(
    facts: Facts, heard: Mapping[str, KeyRate], expression: str, now_ns: int
) -> list[Row]:
    """List what an expression means: keys in the table's order, foreign ones last.

    Args:
        facts: What services say. heard: What was listened to, by key.
        expression: Only these keys. now_ns: Wall clock.
    """
    told = {
        topic.key
        for beats in facts.beats.values()
        for topic in beats[-1].status.topics
        if topic.sent
    }
    keys = sorted(key for key in told | set(heard) if meets(key, expression))
    rows: list[Row] = []
    for topic in rows_of(expression):
        own = [key for key in keys if find(key) is topic]
        rows += [_key_row(facts, heard, key, topic, now_ns) for key in sorted(own, key=_order)]
        if not own:
            rows.append(_empty_row(facts, topic, expression))
    rows += [_key_row(facts, heard, key, None, now_ns) for key in keys if find(key) is None]
    return rows


def lines(rows: list[Row]) -> list[str]:
    """Write the list as a table."""
    titles = ("key", "message", "declared", "seen /s", "size", "sender", "state")
    cells = [
        (
            row.key,
            row.message,
            f"{row.declared_hz:g}" if row.declared_hz else "-",
            "-" if row.rate_hz is None else f"{row.rate_hz:.1f}",
            "-" if row.mean_bytes is None else size(row.mean_bytes),
            row.sender,
            row.state,
        )
        for row in rows
    ]
    return columns(titles, cells, "  rrr")


def message_name(topic: Topic[Any]) -> str:
    """Return the message of a row, as the README names it."""
    name: str = getattr(topic.message, "__name__", "Cloud")
    return "Cloud" if name == "Annotated" else name


def _order(key: str) -> tuple[int, str]:
    return len(key), key  # cams/9 before cams/10.


def _key_row(
    facts: Facts, heard: Mapping[str, KeyRate], key: str, topic: Topic[Any] | None, now_ns: int
) -> Row:
    rate = heard.get(key)
    senders = sorted(facts.senders(key))
    span = None if rate is None else rate.span(now_ns)
    if rate is not None and rate.last is not None:
        senders = sorted({*senders, address_of(rate.last.src)})
    return Row(
        key=key,
        message="not in the topic table" if topic is None else message_name(topic),
        declared_hz=None if topic is None else topic.rate_hz,
        rate_hz=None if span is None else span.rate_hz,
        mean_bytes=None if span is None else span.mean_bytes,
        sender=", ".join(senders) or "?",
        state=_state(facts, key, rate, now_ns),
    )


def _state(facts: Facts, key: str, rate: KeyRate | None, now_ns: int) -> str:
    if rate is None:
        count = sum(topic.count for topic in facts.senders(key).values())
        return f"silent; {count} sent before"
    silent_s = rate.span(now_ns).silent_s
    refused = sum(topic.bad for topic in facts.readers(key).values())
    remarks = {
        f"silent for {silent_s or 0:.1f} s": silent_s,
        f"lost {rate.lost}": rate.lost > 0,
        f"{rate.unnumbered} without envelope": rate.unnumbered,
        f"restarted {rate.restarts}x": rate.restarts and not rate.several_senders,
        "several senders at once": rate.several_senders,
        f"{refused} refused by readers": refused,
    }
    return ", ".join(words for words, applies in remarks.items() if applies) or "ok"


def _empty_row(facts: Facts, topic: Topic[Any], expression: str) -> Row:
    there = topic.sender == "all" or facts.instances(topic.sender)
    if topic.delivery is Delivery.QUERY:
        state = "on request" if there else f"on request; no {topic.sender} is alive"
    else:
        state = "not sent" if there else f"no {topic.sender} is alive"
    key = expression if find(expression) is topic else readable(topic)
    return Row(key, message_name(topic), topic.rate_hz, None, None, topic.sender, state)


def expressions_of_all() -> list[str]:
    """Return what to listen to in order to hear everything.

    The rows one by one first: where access is restricted, each alone is allowed and `**` is not.
    """
    rows = [topic.expression() for topic in TOPICS if topic.delivery is not Delivery.QUERY]
    return [*rows, "**"]
