"""The board: who is well, what is missing, when a run is over."""

import time

import pytest
from rich.console import Console

from schemas.sim import SimClock
from schemas.status import ServiceStatus, TopicStatus
from services.launcher.board import LAST_SCORE_S, SILENT_AFTER_S, Board
from services.launcher.processes import ProcessSpec
from services.launcher.report import Record
from services.launcher.status_table import headline, table
from services.launcher.supervisor import Child

pytestmark = pytest.mark.unit

NAMES = ("router", "simulator", "planner", "mapper", "camera/0", "camera/1")


class Running:
    """What a board reads of a process: its number."""

    def __init__(self, pid):
        self.pid = pid


def child(name, pid):
    return Child(ProcessSpec(name, ("true",)), state="running", process=Running(pid))


def status(name, pid, key="formation", rate_hz=14.0):
    service, _, instance = name.partition("/")
    stream = TopicStatus(
        key=key,
        sent=True,
        count=10,
        rate_hz=rate_hz,
        declared_hz=15,
        alive=True,
        rate_ok=True,
        lost=0,
        bad=0,
        shared_memory=0,
    )
    return ServiceStatus(
        t_ns=0,
        tick=0,
        frame_id="none",
        service=service,
        instance=instance or "0",
        pid=pid,
        uptime_s=1,
        cpu_s=1,
        rss_bytes=10**8,
        shm_used=None,
        bad_messages=0,
        topics=(stream,),
        stages=(),
    )


def clock(state="running", waiting_for=(), dropped=(), tick=0):
    return SimClock(
        t_ns=0,
        tick=tick,
        frame_id="world",
        dt_ns=10**8,
        mode="lockstep",
        state=state,
        waiting_for=waiting_for,
        dropped=dropped,
    )


@pytest.fixture
def board():
    """A run that has just become well: all have reported at time 0."""
    children = {name: child(name, pid) for pid, name in enumerate(NAMES, start=100)}
    board = Board(children, num_ticks=10, record=Record(2))
    for name, each in children.items():
        if name != "router":
            board.add_status(status(name, each.pid), now_s=0.0)
    return board


def text_of(renderable):
    console = Console(width=160, record=True, file=None, quiet=False)
    with console.capture() as captured:
        console.print(renderable)
    return captured.get()


def test_who_has_reported_is_up_and_who_stops_is_silent(board):
    assert {board.health(name, 1.0) for name in NAMES} == {"up"}
    later_s = SILENT_AFTER_S + 0.1
    assert board.health("camera/1", later_s) == "silent"
    assert board.health("router", later_s) == "up"


def test_a_restarted_process_is_starting_until_it_reports_itself(board):
    board.children["mapper"].process = Running(999)
    assert board.health("mapper", 1.0) == "starting"
    board.add_status(status("mapper", 999), now_s=1.0)
    assert board.health("mapper", 1.0) == "up"


@pytest.mark.parametrize(
    ("state", "health"),
    [("waiting", "restarting"), ("failed", "given up")],
)
def test_a_process_that_does_not_run_says_why(board, state, health):
    board.children["camera/0"].state = state
    assert board.health("camera/0", 1.0) == health


def test_a_run_whose_clock_has_ended_waits_for_the_last_score_but_not_for_ever(board):
    board.children["evaluator"] = child("evaluator", 200)
    board.clock = clock("finished", tick=9)
    board.finished_s = time.monotonic()
    assert not board.finished
    board.finished_s -= LAST_SCORE_S + 0.1
    assert board.finished


def test_all_are_heard_when_each_has_reported_and_the_failed_do_not_count(board):
    assert board.all_heard
    board.children["evaluator"] = child("evaluator", 200)
    assert not board.all_heard
    board.children["evaluator"].state = "failed"
    assert board.all_heard


def test_what_is_missing_is_named(board):
    assert board.missing(1.0) == "the simulator has not said anything yet"
    board.clock = clock("waiting", waiting_for=("camera/1", "mapper"))
    assert board.missing(1.0) == "tick 0 waits for camera/1, mapper"
    board.clock = clock(dropped=("camera/0",))
    assert board.missing(1.0) == "given up on: camera/0"
    board.clock = clock()
    assert board.missing(1.0) == "no instant has been fused yet"
    board.children["planner"].state = "failed"
    assert board.missing(1.0) == "given up: planner"


def test_the_stream_of_a_service_is_the_one_it_is_judged_by(board):
    assert board.main_stream("planner").rate_hz == 14.0
    board.add_status(status("camera/1", 105, key="cams/1/cloud", rate_hz=9.0), now_s=0.0)
    assert board.main_stream("camera/1").rate_hz == 9.0
    assert board.main_stream("camera/0") is None
    assert board.main_stream("router") is None


def test_the_table_has_a_row_for_everybody_and_says_what_is_missing(board):
    text = text_of(table(board, 1.0))
    assert all(name in text for name in NAMES)
    assert "the simulator has not said anything yet" in text


def test_many_cameras_are_counted_instead_of_listed():
    names = [f"camera/{index}" for index in range(64)]
    children = {name: child(name, pid) for pid, name in enumerate(names, start=100)}
    board = Board(children, num_ticks=None, record=Record(64))
    for name, each in children.items():
        board.add_status(status(name, each.pid), now_s=0.0)
    text = text_of(table(board, 0.0))
    assert "... 48 more" in text
    assert "64 of all up" in text


def test_the_headline_counts_instants(board):
    assert headline(board) == "instant 0 of 10"
    assert not board.finished
