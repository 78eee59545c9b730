"""The examination of a running system: facts in, verdicts out."""

from collections.abc import Iterator, Mapping

from schemas.status import TopicStatus
from services.inspector import remedies
from services.inspector.diagnosis import router_verdict
from services.inspector.facts import Beat, Facts
from services.inspector.pace import Pace
from services.inspector.verdict import Level, Verdict
from services.runtime.meter import RATE_SHARE

MAX_CLOCK_OFFSET_S = 0.02
"""A third of an instant at 15 Hz; PTP and chrony keep machines of one network within 1 ms."""
MIN_SPAN_NS = 500_000_000
"""Less tells no rate."""
NEEDED = ("planner", "mapper", "camera")
OPTIONAL = {
    "simulator": "real cameras and a tracker need none",
    "evaluator": "nobody scores the map",
}


def examine(facts: Facts, version: str) -> list[Verdict]:
    """Examine all that is known.

    Args:
        facts: Of a look of at least two heartbeats.
        version: Of encircle as it is installed here.
    """
    router = router_verdict(facts)
    if router.level is Level.FAILED:
        return [router]
    if not facts.alive and not facts.beats:
        return [router, Verdict(Level.FAILED, "services", "no service is alive", remedies.START)]
    now = not facts.replayed
    return [
        router,
        *(_services(facts) if now else [_replay(facts)]),
        *_rates(facts),
        *_messages(facts),
        *_shared_memory(facts),
        *(_clocks(facts) if now else ()),
        *(_versions(facts, version) if now else ()),
    ]


def _replay(facts: Facts) -> Verdict:
    what = (
        f"{', '.join(facts.instances('replay'))} is alive: what is said is as it was recorded; "
        "services, clocks and versions are those of then and not examined"
    )
    return Verdict(Level.NOTE, "replay", what)


def _services(facts: Facts) -> Iterator[Verdict]:
    for address in sorted(facts.alive - set(facts.beats)):
        what = f"{address} is alive and sends no heartbeat: it hangs, or has only just come up"
        mend = f"stop it; {remedies.start(address, facts.connect)}"
        # The launcher and tools are there without a loop of their own.
        if address.partition("/")[0] in (*NEEDED, *OPTIONAL):
            yield Verdict(Level.FAILED, "services", what, mend)
    for address in sorted(set(facts.beats) - facts.alive):
        mend = remedies.start(address, facts.connect)
        yield Verdict(Level.FAILED, "services", f"{address} was heard and is gone", mend)
    for service in NEEDED:
        if not facts.instances(service):
            mend = remedies.start(service, facts.connect)
            yield Verdict(Level.FAILED, "services", f"no {service} is alive", mend)
    for service, without in OPTIONAL.items():
        if not facts.instances(service):
            mend = remedies.start(service, facts.connect)
            yield Verdict(Level.NOTE, "services", f"no {service} is alive: {without}", mend)
    who = ", ".join(sorted(facts.alive, key=lambda name: (name.split("/")[0], len(name), name)))
    yield Verdict(Level.GOOD, "services", f"{len(facts.alive)} alive: {who}")


def _rates(facts: Facts) -> Iterator[Verdict]:
    """Rates between the first and the last heartbeat, by the senders' own counters and clocks."""
    pace = Pace(facts.clocks, facts.connect)
    yield from pace.verdicts()
    if not pace.runs or any(clock.state != "running" for clock in facts.clocks[-1:]):
        return
    num_good = 0
    for address, beats in sorted(facts.beats.items()):
        from_ns, to_ns = beats[0].t_pub_ns, beats[-1].t_pub_ns
        for topic, num in _sent(beats):
            due = pace.expected(topic.declared_hz, from_ns, to_ns)
            if num + 1 >= RATE_SHARE * due:  # Of a span either end may be cut.
                num_good += 1
                continue
            span_s = (to_ns - from_ns) * 1e-9
            what = f"{topic.key} at {num / span_s:.1f} Hz of {due / span_s:.1f} Hz, from {address}"
            slow = max(beats[-1].status.stages, key=lambda each: each.p95_ms, default=None)
            where = f"; its slowest stage: {slow.name} {slow.p95_ms:.0f} ms" if slow else ""
            yield Verdict(Level.FAILED, "rates", what + where, remedies.FASTER)
    if num_good:
        pace_words = f" ({pace.words})" if pace.words else ""
        yield Verdict(Level.GOOD, "rates", f"{num_good} streams at their rate{pace_words}")


def _sent(beats: tuple[Beat, ...]) -> Iterator[tuple[TopicStatus, int]]:
    """Streams that a service sends, and how many messages between its heartbeats."""
    first, last = beats[0], beats[-1]
    if last.t_pub_ns - first.t_pub_ns < MIN_SPAN_NS or first.status.pid != last.status.pid:
        return
    before = {topic.key: topic.count for topic in first.status.topics if topic.sent}
    for topic in last.status.topics:
        if topic.sent and topic.declared_hz and topic.key in before:
            yield topic, topic.count - before[topic.key]


def _messages(facts: Facts) -> Iterator[Verdict]:
    for address, beats in sorted(facts.beats.items()):
        last = beats[-1].status
        fresh = last.bad_messages - beats[0].status.bad_messages
        if fresh > 0:
            what = f"{address} refused {fresh} messages just now, the last: {last.bad_reason}"
            key = last.bad_reason.partition(":")[0]
            yield Verdict(Level.FAILED, "messages", what, f"encircle echo '{key}' --once")
        elif last.bad_messages:
            what = f"{address} has refused {last.bad_messages} since its start: {last.bad_reason}"
            yield Verdict(Level.NOTE, "messages", what)
    lost = {address: _lost(beats) for address, beats in sorted(facts.beats.items())}
    for address, keys in lost.items():
        if keys:
            words = ", ".join(f"{num} of {key}" for key, num in keys.items())
            yield Verdict(Level.NOTE, "messages", f"{address} missed {words}; newer ones came")
    if not any(lost.values()):
        yield Verdict(Level.GOOD, "messages", "none lost between the heartbeats")


def _lost(beats: tuple[Beat, ...]) -> Mapping[str, int]:
    before = {topic.key: topic.lost for topic in beats[0].status.topics if not topic.sent}
    fresh = {
        topic.key: topic.lost - before.get(topic.key, topic.lost)
        for topic in beats[-1].status.topics
        if not topic.sent
    }
    return {key: num for key, num in fresh.items() if num > 0}


def _shared_memory(facts: Facts) -> Iterator[Verdict]:
    last = {address: beats[-1].status for address, beats in sorted(facts.beats.items())}
    without = [address for address, status in last.items() if status.shm_used is False]
    using = [address for address, status in last.items() if status.shm_used]
    if without:
        what = f"off for {', '.join(without)}: large messages go over the network"
        mend = "ulimit -l unlimited, in compose ipc: shareable; --bus.shm-pool-mib not 0"
        yield Verdict(Level.FAILED, "shared memory", what, mend)
    if using:
        yield Verdict(Level.GOOD, "shared memory", f"on for {', '.join(using)}")
    if not without and not using:
        yield Verdict(Level.NOTE, "shared memory", "nobody has sent anything large yet")


def _clocks(facts: Facts) -> Iterator[Verdict]:
    """A sender's stamp is never after our reception, nor long before it: else clocks differ."""
    off = {
        address: delay_s
        for address, delay_s in sorted(facts.delays_s.items())
        if not -MAX_CLOCK_OFFSET_S <= delay_s <= MAX_CLOCK_OFFSET_S
    }
    for address, delay_s in off.items():
        status = facts.last(address)
        host = f" on {status.host}" if status is not None and status.host else ""
        side = "ahead of" if delay_s < 0 else "behind"
        what = f"the clock of {address}{host} is {abs(delay_s) * 1e3:.0f} ms {side} ours"
        if delay_s > 0:
            what += ", or what it says takes so long"
        yield Verdict(Level.FAILED, "clocks", what, "chronyc makestep, on both machines")
    if facts.delays_s and not off:
        most_ms = max(facts.delays_s.values()) * 1e3
        what = f"{len(facts.delays_s)} senders within {most_ms:.1f} ms of ours, transport included"
        yield Verdict(Level.GOOD, "clocks", what)


def _versions(facts: Facts, version: str) -> Iterator[Verdict]:
    by_version: dict[str, list[str]] = {}
    for address, beats in sorted(facts.beats.items()):
        by_version.setdefault(beats[-1].status.version, []).append(address)
    others = {told: who for told, who in by_version.items() if told != version}
    for told, who in others.items():
        what = f"{', '.join(who)}: encircle {told or 'of an unknown version'}; here {version}"
        mend = f"pip install 'encircle=={version}' where they run, and start them anew"
        yield Verdict(Level.FAILED, "versions", what, mend)
    if by_version and not others:
        yield Verdict(Level.GOOD, "versions", f"encircle {version} everywhere")
