"""`encircle list`: all keys, declared and heard."""

import time

from services.inspector import plain
from services.inspector.diagnosis import why_silent
from services.inspector.expressions import meets
from services.inspector.hearing import Hearing
from services.inspector.inventory import expressions_of_all, inventory, lines
from services.inspector.listening_service import Write, open_bus
from services.inspector.settings import ListSettings
from services.inspector.witness_service import Witness, ask_for_router
from services.runtime.bus import Bus
from services.runtime.tap import Tap


def list_keys(settings: ListSettings, out: Write, tell: Write) -> int:
    """Listen for a moment, then list.

    Returns:
        0, or 1 when nothing that was asked for was heard.
    """
    router = ask_for_router(settings.bus)
    with open_bus(settings.bus) as bus, Witness(bus, settings.bus) as witness:
        heard = hear(bus, expressions_of_all(), 0.0 if router.fault else settings.listen)
        facts = witness.facts(router)
    rows = inventory(facts, heard.rates, settings.expression, time.time_ns())
    if settings.json_:
        for row in rows:
            out(plain.as_json(row.plain()))
    elif rows:
        for line in lines(rows):
            out(line)
    if any(meets(key, settings.expression) for key in heard.rates):
        return 0
    tell("nothing comes:")
    for verdict in why_silent(facts, settings.expression)[:1]:
        for line in verdict.lines():
            tell(line)
    return 1


def hear(bus: Bus, expressions: list[str], seconds: float) -> Hearing:
    """Take in all that comes for some time."""
    hearing = Hearing()
    end_s = time.monotonic() + seconds
    with Tap(bus, expressions) as tap:
        while (left_s := end_s - time.monotonic()) > 0:
            try:
                sample = tap.get(left_s)
            except TimeoutError:
                break
            hearing.add(sample.key, sample.payload, sample.received_ns)
    return hearing
