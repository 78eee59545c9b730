"""An empty view is never silent: it names what is missing and the command that mends it."""

import pytest

from schemas.sim import SimClock
from schemas.topics import MAP_CHANGES
from services.viewer.newest import Newest
from services.viewer.notices import SILENT_S, STREAMS, Situation, notices, summary_line

pytestmark = pytest.mark.unit

NOW_S = 1000.0
ALL = frozenset({"simulator", "camera", "planner", "mapper", "evaluator", "launcher", "viewer"})


def clock(state="running", **fields):
    return SimClock(
        t_ns=0, tick=41, frame_id="world", dt_ns=50_000_000, mode="lockstep", state=state, **fields
    )


def situation(
    *,
    silent=(),
    alive=ALL,
    state="running",
    watched_s=60.0,
    occupied=100,
    router="tcp/127.0.0.1:7447",
    **fields,
):
    """All flows but the streams of `silent` services."""
    heard = {
        key: NOW_S - (20.0 if stream.service in silent else 0.1)
        for stream in STREAMS
        for key in stream.keys
    }
    newest = Newest(heard_s=heard, clock=None if state is None else clock(state))
    return Situation(
        now_s=NOW_S,
        since_s=NOW_S - watched_s,
        router=router,
        alive=alive,
        newest=newest,
        num_occupied=occupied,
        num_drawn=min(occupied or 0, 50_000),
        **fields,
    )


def test_when_all_flows_there_is_nothing_to_say():
    assert notices(situation()) == []


def test_an_empty_bus_names_the_router_and_the_command():
    made = situation(alive=frozenset({"viewer"}), state=None, occupied=None)
    made.newest.heard_s.clear()
    (only,) = notices(made)
    assert "tcp/127.0.0.1:7447" in only
    assert "`encircle run`" in only


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.keys[0])
def test_a_service_that_is_not_there_is_named_with_the_command_that_starts_it(stream):
    found = notices(situation(silent={stream.service}, alive=ALL - {stream.service}))
    told = "\n".join(found)
    assert stream.keys[0].replace("{camera}", "*") in told
    assert f"`{stream.command}`" in told
    assert "20 s" in told
    assert all(stream.service in line for line in found)


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.keys[0])
def test_a_service_that_is_there_and_silent_is_named_too(stream):
    found = notices(situation(silent={stream.service}))
    assert found
    assert all(f"though a {stream.service} is running" in line for line in found)
    assert all("`encircle doctor`" in line for line in found)


def test_the_commands_know_the_way_to_another_router():
    elsewhere = "tcp/192.168.1.5:7447"
    gone = situation(silent={"mapper"}, alive=ALL - {"mapper"}, router=elsewhere)
    assert f"`encircle mapper --bus.connect {elsewhere}`" in notices(gone)[0]
    stuck = situation(silent={"mapper"}, router=elsewhere)
    assert f"`encircle doctor --bus.connect {elsewhere}`" in notices(stuck)[0]


def test_a_topic_that_never_came_is_missed_as_long_as_somebody_looks():
    made = situation(watched_s=7.0)
    del made.newest.heard_s[MAP_CHANGES.key]
    assert "No `map/changes` for 7 s" in notices(made)[0]


def test_who_has_just_begun_to_look_is_given_a_moment():
    made = situation(watched_s=SILENT_S - 0.1)
    made.newest.heard_s.clear()
    assert notices(made) == []


@pytest.mark.parametrize("state", ["paused", "finished"])
def test_a_clock_that_stands_is_the_reason_and_not_the_silent_services(state):
    everybody = {stream.service for stream in STREAMS}
    (only,) = notices(situation(silent=everybody, state=state))
    assert "41" in only or "42" in only
    assert "press" in only


def test_who_is_waited_for_and_who_was_given_up_is_told():
    made = situation()
    made.newest.clock = clock("waiting", waiting_for=("planner", "camera/3"), dropped=("camera/1",))
    told = " ".join(notices(made))
    assert "Tick 41 waits for planner, camera/3" in told
    assert "Given up on camera/1" in told


def test_an_empty_map_is_said_to_be_empty():
    (only,) = notices(situation(occupied=0))
    assert "no occupied voxel" in only
    assert "encircle mapper" in only


def test_refusals_are_shown_with_their_reason():
    (only,) = notices(situation(refusals={"mapper/0": "cams/1/cloud: too large"}))
    assert only == "mapper/0 refuses messages: cams/1/cloud: too large"


def test_the_true_count_is_shown_when_not_all_are_drawn():
    assert "123,456 voxels, 50,000 drawn" in summary_line(situation(occupied=123_456))
    assert "drawn" not in summary_line(situation(occupied=5))


REPLAY = frozenset({"replay", "viewer"})


def test_a_replay_needs_no_service_as_long_as_its_messages_flow():
    assert notices(situation(alive=REPLAY)) == []


def test_a_replay_that_stands_still_is_named_and_no_service_is_missed():
    everybody = {stream.service for stream in STREAMS}
    (only,) = notices(situation(alive=REPLAY, silent=everybody))
    assert "Resume replay" in only


def test_what_was_not_recorded_is_named():
    (only,) = notices(situation(alive=REPLAY, silent={"mapper"}))
    assert "`map/changes`" in only
    assert "the map cannot be shown" in only
