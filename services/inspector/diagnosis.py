"""Why nothing comes on a key: facts in, verdicts out."""

from typing import Any

from schemas.topics import TOPICS, Delivery, Topic, camera_of, find
from services.inspector import remedies
from services.inspector.expressions import nearest, readable, rows_of
from services.inspector.facts import Facts
from services.inspector.verdict import Level, Verdict

_DRIVING = ("simulator", "planner")
"""Without these no instant comes, and the others wait."""


def router_verdict(facts: Facts) -> Verdict:
    """Tell whether there is a router that takes a new session."""
    found, where = facts.router, facts.connect
    if found.refused:
        mend = f"{remedies.START}, and then --bus.connect with the endpoint that it prints"
        return Verdict(Level.FAILED, "router", f"nobody listens at {where}", mend)
    if found.fault:
        what = f"{where} takes connections and no new session: {found.fault}"
        mend = f"end that router, then: {remedies.router(where)} (services find it by themselves)"
        return Verdict(Level.FAILED, "router", what, mend)
    version = f", zenoh {found.version}" if found.version else ""
    return Verdict(
        Level.GOOD,
        "router",
        f"{where} took a new session in {found.seconds * 1e3:.0f} ms{version}, "
        f"{found.sessions} sessions",
    )


def why_silent(facts: Facts, expression: str) -> list[Verdict]:
    """Tell why nothing is heard on an expression; at least one verdict, the gravest first."""
    router = router_verdict(facts)
    if router.level is Level.FAILED:
        return [router]
    rows = rows_of(expression)
    if not rows:
        return [_unknown(facts, expression)]
    if not facts.alive and not facts.beats:
        what = "the router is there and no service is alive"
        return [Verdict(Level.FAILED, expression, what, remedies.START)]
    return [_silent_row(facts, expression, row) for row in rows]


def _unknown(facts: Facts, expression: str) -> Verdict:
    sent = sorted(
        {topic.key for beats in facts.beats.values() for topic in beats[-1].status.topics}
    )
    close = nearest(expression, sent)
    known = ", ".join(readable(topic) for topic in TOPICS)
    meant = f"perhaps {close}" if close else "encircle list"
    what = f"no such key in the topic table, and nobody sends it; known: {known}"
    return Verdict(Level.FAILED, expression, what, meant)


def _silent_row(facts: Facts, expression: str, row: Topic[Any]) -> Verdict:
    about = expression if find(expression) is row else readable(row)
    sender = _sender(facts, expression, row)
    if isinstance(sender, Verdict):
        return sender
    if row.delivery is Delivery.QUERY:
        return Verdict(Level.NOTE, about, "is sent on request only", f"encircle echo {row.key}")
    last = facts.last(sender)
    if last is None:
        what = f"{sender} is alive and sends no heartbeat: it hangs, or has only just come up"
        return Verdict(Level.FAILED, about, what, f"stop it; {_start(facts, sender)}")
    sends = [topic for topic in last.topics if topic.sent and find(topic.key) is row]
    if find(expression) is row:
        others = ", ".join(topic.key for topic in sends)
        sends = [topic for topic in sends if topic.key == expression]
        if not sends and others:
            what = f"{sender} sends {others}, and not this"
            return Verdict(Level.FAILED, about, what, "ask for one of these")
    if any(topic.alive and topic.count for topic in sends):
        rate_hz = max(topic.rate_hz for topic in sends)
        what = f"{sender} says that it sends it at {rate_hz:.1f} Hz, and nothing comes to us"
        mend = "let it be reached from here: --bus.listen tcp/<address of its machine>:0"
        return Verdict(Level.FAILED, about, what, mend)
    return _idle(facts, about, sender, row, sum(topic.count for topic in sends))


def _sender(facts: Facts, expression: str, row: Topic[Any]) -> str | Verdict:
    """Who ought to send, or the verdict that it is not there."""
    service = row.sender
    if service == "all":
        parts = expression.split("/")
        if "*" in expression:
            return min(facts.alive | set(facts.beats))
        service, instance = parts[1], parts[2] if len(parts) > 2 else "0"
    else:
        camera = camera_of(expression) if service == "camera" else None
        instance = "0" if camera is None else str(camera)
        if camera is None and (there := facts.instances(service)):
            return there[0]
    address = f"{service}/{instance}"
    if address in facts.alive:
        return address
    alive = ", ".join(sorted(facts.alive)) or "nobody"
    what = f"its sender {address} is not alive; alive: {alive}"
    about = expression if find(expression) is row else readable(row)
    return Verdict(Level.FAILED, about, what, _start(facts, address))


def _idle(facts: Facts, about: str, sender: str, row: Topic[Any], count: int) -> Verdict:
    """The verdict on a sender that is well and does not send."""
    before = f"has sent {count} before" if count else "has not sent it yet"
    if facts.clocks and (state := facts.clocks[-1].state) != "running":
        clock = facts.clocks[-1]
        waits = f" for {', '.join(clock.waiting_for)}" if clock.waiting_for else ""
        mend = remedies.for_clock(clock, facts.connect)
        what = f"{sender} {before}: the simulation is {state}{waits} at tick {clock.tick}"
        return Verdict(Level.FAILED, about, what, mend)
    if mend := remedies.optional(row.key):
        what = f"{sender} is alive and {before}: it is sent only if asked for"
        return Verdict(Level.NOTE, about, what, mend)
    missing = [service for service in _DRIVING if not facts.instances(service)]
    if missing:
        what = f"{sender} is alive and {before}; without {' and '.join(missing)} no instant comes"
        return Verdict(Level.FAILED, about, what, remedies.start(missing[0], facts.connect))
    what = f"{sender} is alive and {before}"
    return Verdict(Level.FAILED, about, what, "encircle doctor")


def _start(facts: Facts, address: str) -> str:
    return remedies.start(address, facts.connect)
