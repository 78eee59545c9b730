"""`encircle info`: all about a key."""

import time
from typing import Any

from schemas.status import TopicStatus
from schemas.topics import Delivery, Topic
from services.inspector import plain
from services.inspector.description import describe
from services.inspector.diagnosis import why_silent
from services.inspector.expressions import readable, rows_of
from services.inspector.facts import Facts
from services.inspector.hearing import Hearing
from services.inspector.inventory import message_name
from services.inspector.list_service import hear
from services.inspector.listening_service import SILENT_S, Write, open_bus
from services.inspector.schema_words import schema_lines
from services.inspector.settings import InfoSettings
from services.inspector.witness_service import Witness, ask_for_router

MAX_ITEMS = 4


def info(settings: InfoSettings, out: Write, tell: Write) -> int:
    """Tell of a key; the table's part also when nothing runs.

    Returns:
        0, or 1 when the key is in no row and nothing was heard of it.
    """
    router = ask_for_router(settings.bus)
    with open_bus(settings.bus) as bus, Witness(bus, settings.bus) as witness:
        heard = hear(bus, [settings.key], 0.0 if router.fault else SILENT_S)
        facts = witness.facts(router)
    rows = rows_of(settings.key)
    if settings.json_:
        out(plain.as_json(_plain(settings.key, rows, facts, heard)))
    else:
        for row in rows:
            for line in _row_lines(row):
                out(line)
        for line in _live_lines(settings.key, facts, heard):
            out(line)
    on_request = all(row.delivery is Delivery.QUERY for row in rows)
    if not heard.rates and not (rows and on_request):
        tell("nothing comes:")
        for verdict in why_silent(facts, settings.key):
            for line in verdict.lines():
                tell(line)
    return 0 if rows or heard.rates else 1


def _row_lines(row: Topic[Any]) -> list[str]:
    shared = ", shared memory" if row.shared_memory else ""
    rate = f"{row.rate_hz:g} Hz" if row.rate_hz else "no rate promised"
    head = f"{readable(row)}  {message_name(row)}  {rate}  {row.delivery.value}{shared}"
    return [f"{head}  from {row.sender}", *(f"  {line}" for line in schema_lines(row.message)), ""]


def _live_lines(expression: str, facts: Facts, heard: Hearing) -> list[str]:
    lines = []
    for key in _keys(expression, heard):
        lines += _ends("sent by", facts.senders(key), key)
        lines += _ends("read by", facts.readers(key), key)
    if heard.newest:
        key, payload = next(iter(sorted(heard.newest.items())))
        said = describe(key, payload)
        lines += [f"last on {key}:" if not said.fault else said.line]
        lines += [f"  {line}" for line in plain.text(said.fields, MAX_ITEMS)]
    return lines


def _keys(expression: str, heard: Hearing) -> list[str]:
    return sorted(heard.rates) or [expression]


def _ends(what: str, ends: dict[str, TopicStatus], key: str) -> list[str]:
    return [
        f"{key}  {what} {address}: {topic.count} messages, {topic.rate_hz:.1f} Hz, "
        f"lost {topic.lost}, refused {topic.bad}, by shared memory {topic.shared_memory}"
        for address, topic in ends.items()
    ]


def _plain(
    expression: str, rows: tuple[Topic[Any], ...], facts: Facts, heard: Hearing
) -> dict[str, Any]:
    now_ns = time.time_ns()
    return {
        "key": expression,
        "rows": [
            {
                "key": row.key,
                "message": message_name(row),
                "rate_hz": row.rate_hz,
                "delivery": row.delivery.value,
                "shared_memory": row.shared_memory,
                "sender": row.sender,
                "schema": row.adapter.json_schema(),
            }
            for row in rows
        ],
        "keys": {
            key: {
                "rate_hz": heard.rates[key].span(now_ns).rate_hz if key in heard.rates else None,
                "senders": {who: each.model_dump() for who, each in facts.senders(key).items()},
                "readers": {who: each.model_dump() for who, each in facts.readers(key).items()},
                "last": describe(key, heard.newest[key]).fields if key in heard.newest else None,
            }
            for key in _keys(expression, heard)
        },
    }
