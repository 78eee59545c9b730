"""From facts to findings: each names what is missing and the command that mends it."""

from dataclasses import replace

import pytest

from schemas.sim import SimClock
from schemas.status import ServiceStatus, TopicStatus
from services.inspector.checkup import examine
from services.inspector.diagnosis import why_silent
from services.inspector.facts import Beat, Facts, RouterFacts
from services.inspector.verdict import Level

pytestmark = pytest.mark.unit

BEGIN_NS = 1_700_000_000_000_000_000
HERE = "tcp/127.0.0.1:7447"
SENT = {
    "simulator/0": ("sim/state", "target/pose"),
    "planner/0": ("formation", "cams/0/goal", "cams/1/goal"),
    "mapper/0": ("map/summary",),
    "camera/0": ("cams/0/pose", "cams/0/cloud"),
    "camera/1": ("cams/1/pose", "cams/1/cloud"),
    "evaluator/0": ("metrics/quality",),
}


def stream(key, count, rate_hz=15.0):
    return TopicStatus(
        key=key,
        sent=True,
        count=count,
        rate_hz=rate_hz,
        declared_hz=15.0,
        alive=rate_hz > 0,
        rate_ok=rate_hz > 13,
        lost=0,
        bad=0,
        shared_memory=0,
    )


def beat(address, second, num_per_s=15, shm_used=None, **fields):
    service, instance = address.split("/")
    topics = tuple(stream(key, 100 + num_per_s * second, num_per_s) for key in SENT[address])
    known = {
        "version": "0.1.0",
        "host": "here",
        "bad_messages": 0,
        "topics": topics,
        "stages": (),
    }
    status = ServiceStatus(
        t_ns=0,
        tick=0,
        frame_id="none",
        service=service,
        instance=instance,
        pid=7,
        uptime_s=9.0,
        cpu_s=1.0,
        rss_bytes=1,
        shm_used=shm_used,
        **{**known, **fields},
    )
    return Beat(status, BEGIN_NS + second * 1_000_000_000)


def clock(second, per_s=15, mode="realtime", state="running", **fields):
    return SimClock(
        t_ns=0,
        tick=per_s * second,
        frame_id="world",
        dt_ns=66_666_667,
        mode=mode,
        state=state,
        t_wall_ns=BEGIN_NS + second * 1_000_000_000,
        **fields,
    )


def well(num_per_s=15, mode="realtime"):
    """A system of two cameras in which all is as it should be."""
    return Facts(
        connect=HERE,
        router=RouterFacts(seconds=0.004, version="1.10.2", sessions=9),
        alive=frozenset(SENT),
        beats={
            address: (beat(address, 0, num_per_s), beat(address, 2, num_per_s, True))
            for address in SENT
        },
        clocks=(clock(0, num_per_s, mode), clock(2, num_per_s, mode)),
        delays_s=dict.fromkeys(SENT, 0.0005),
    )


def failed(facts, version="0.1.0"):
    return [each for each in examine(facts, version) if each.level is Level.FAILED]


def changed(facts, address, **fields):
    return replace(
        facts, beats={**facts.beats, address: (beat(address, 0), beat(address, 2, **fields))}
    )


@pytest.mark.parametrize(
    ("num_per_s", "mode"), [(15, "realtime"), (29, "lockstep"), (4, "lockstep")]
)
def test_all_is_well_at_any_pace_of_lockstep_and_at_that_of_the_clock(num_per_s, mode):
    verdicts = examine(well(num_per_s, mode), "0.1.0")
    assert {each.level for each in verdicts} == {Level.GOOD}
    about = [each.about for each in verdicts]
    assert about == [
        "router",
        "services",
        "rates",
        "messages",
        "shared memory",
        "clocks",
        "versions",
    ]


def test_every_failed_line_has_a_remedy():
    facts = replace(
        changed(well(), "camera/1", num_per_s=9, shm_used=False, version="0.0.9"),
        delays_s={"camera/0": -0.4, "camera/1": 0.3},
    )
    found = failed(facts)
    assert {each.about for each in found} == {"rates", "shared memory", "clocks", "versions"}
    assert all(each.mend for each in found)
    texts = " ".join(each.what for each in found)
    assert "cams/1/cloud at 9.0 Hz of 15.0 Hz, from camera/1" in texts
    assert "the clock of camera/0 on here is 400 ms ahead of ours" in texts
    assert "camera/1 on here is 300 ms behind ours" in texts
    assert "camera/1: encircle 0.0.9; here 0.1.0" in texts


@pytest.mark.parametrize(
    ("router", "what", "mend"),
    [
        (RouterFacts("nobody listens", refused=True), "nobody listens at tcp/", "encircle run"),
        (
            RouterFacts("timeout"),
            "takes connections and no new session",
            "encircle router --listen",
        ),
    ],
)
def test_without_a_router_nothing_else_is_looked_at(router, what, mend):
    facts = replace(well(), router=router)
    for verdicts in (examine(facts, "0.1.0"), why_silent(facts, "formation")):
        (only,) = verdicts
        assert what in only.what
        assert mend in only.mend
        assert only.level is Level.FAILED


def test_a_router_without_services_is_told():
    facts = Facts(HERE, RouterFacts())
    assert "no service is alive" in failed(facts)[0].what
    assert why_silent(facts, "formation")[0].mend == "encircle run"


def test_a_missing_service_fails_and_an_optional_one_is_noted():
    facts = well()
    there = facts.alive - {"mapper/0", "evaluator/0"}
    facts = replace(facts, alive=there, beats={name: facts.beats[name] for name in there})
    (only,) = failed(facts)
    assert only.what == "no mapper is alive"
    assert only.mend == f"encircle mapper --bus.connect {HERE}"
    assert any("nobody scores" in each.what for each in examine(facts, "0.1.0"))


def test_a_replay_is_told_and_nothing_of_then_is_held_against_now():
    facts = well()
    replayed = replace(
        facts,
        alive=frozenset({"replay/0"}),
        beats={name: beats for name, beats in facts.beats.items() if name != "mapper/0"},
        delays_s=dict.fromkeys(facts.beats, 3600.0),
    )
    verdicts = examine(replayed, "9.9.9")
    assert [each.what for each in verdicts if each.level is Level.FAILED] == []
    (replay,) = [each for each in verdicts if each.about == "replay"]
    assert "replay/0 is alive" in replay.what
    # The same without a replay: all of it is a fault.
    alone = examine(replace(replayed, alive=frozenset({"launcher/0"})), "9.9.9")
    failed_about = {each.about for each in alone if each.level is Level.FAILED}
    assert failed_about >= {"services", "clocks", "versions"}


def test_who_is_alive_without_heartbeat_hangs():
    facts = well()
    facts = replace(facts, beats={name: facts.beats[name] for name in facts.alive - {"camera/1"}})
    (only,) = failed(facts)
    assert "camera/1 is alive and sends no heartbeat" in only.what
    assert "encircle camera --camera 1" in only.mend


def test_who_has_gone_is_named():
    facts = replace(well(), alive=frozenset(SENT) - {"camera/1"})
    (only,) = failed(facts)
    assert only.what == "camera/1 was heard and is gone"
    facts = replace(well(), clocks=(clock(0), clock(2, dropped=("camera/1",))))
    (only,) = failed(facts)
    assert only.what == "the simulation goes on without camera/1"


def test_a_machine_that_is_too_slow_is_told_once_and_not_for_every_stream():
    (only,) = failed(replace(well(9), clocks=(clock(0, 9), clock(2, 9, overruns=7))))
    assert "9.0 of 15.0; 7 came too late" in only.what.replace(" instants/s", "")


def test_a_pause_is_no_failure_and_waiting_is():
    paused = replace(well(), clocks=(clock(1, state="paused"),))
    assert not failed(paused)
    assert "paused" in " ".join(each.what for each in examine(paused, "0.1.0"))
    waits = replace(well(), clocks=(clock(0, state="waiting", waiting_for=("camera/1",)),))
    (only,) = failed(waits)
    assert "waiting for camera/1" in only.what
    assert only.mend == f"encircle camera --camera 1 --bus.connect {HERE}"


def test_refused_messages_fail_when_they_are_new():
    reason = "cams/1/cloud: tick: Field required"
    (only,) = failed(changed(well(), "mapper/0", bad_messages=3, bad_reason=reason))
    assert "mapper/0 refused 3 messages" in only.what
    assert "encircle echo 'cams/1/cloud'" in only.mend


def silence(facts, expression):
    (only,) = why_silent(facts, expression)
    return only


@pytest.mark.parametrize(
    ("expression", "what", "mend"),
    [
        ("cams/0/poze", "no such key in the topic table", "perhaps cams/0/pose"),
        ("map/full", "on request only", "encircle echo map/full"),
        ("cams/0/color", "sent only if asked for", "ENCIRCLE_CAMERA_COLOR=1"),
        ("target/estimate", "sent only if asked for", "encircle run --target filtered"),
        ("cams/5/pose", "its sender camera/5 is not alive; alive: camera/0", "--camera 5"),
        ("cams/5/goal", "planner/0 sends cams/0/goal, cams/1/goal, and not this", "one of these"),
        ("cams/*/cloud", "says that it sends it at 15.0 Hz, and nothing comes", "--bus.listen"),
        ("map/changes", "mapper/0 is alive and has not sent it yet", "encircle doctor"),
        ("metrics/mapper", "mapper/0", ""),
    ],
)
def test_silence_has_a_reason(expression, what, mend):
    verdict = silence(well(), expression)
    assert what in verdict.what
    assert mend in verdict.mend


def test_a_key_of_one_who_is_gone_names_it():
    facts = replace(well(), alive=frozenset(SENT) - {"evaluator/0"})
    assert "its sender evaluator/0 is not alive" in silence(facts, "metrics/quality").what


def test_silence_of_a_paused_simulation_is_told():
    facts = changed(well(), "camera/0", num_per_s=0)
    facts = replace(facts, clocks=(clock(4, state="paused"),))
    assert "the simulation is paused at tick 60" in silence(facts, "cams/0/pose").what


def test_without_a_simulator_no_instant_comes():
    facts = changed(well(), "camera/0", num_per_s=0)
    there = facts.alive - {"simulator/0"}
    facts = replace(facts, clocks=(), alive=there)
    verdict = silence(facts, "cams/0/pose")
    assert "without simulator no instant comes" in verdict.what
    assert verdict.mend == f"encircle simulator --bus.connect {HERE}"
