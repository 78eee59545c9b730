"""How many cameras a run has: who is told what, and when."""

import time

import pytest
from pydantic import ValidationError

from services.launcher.fleet import Fleet
from services.launcher.processes import ProcessSpec
from services.launcher.supervisor import RestartPolicy, Supervisor
from services.runtime.errors import CommandFailed, NoReply

pytestmark = pytest.mark.unit


TIMEOUT_S = 10.0
BROKEN = 7
"""A camera whose process ends at once."""


def table(cameras):
    names = ["planner", "simulator", *(f"camera/{i}" for i in range(cameras))]
    return {
        name: ProcessSpec(name, ("false" if name == f"camera/{BROKEN}" else "sleep", "60"))
        for name in names
    }


class Bench:
    """A fleet of three real processes, and what it has asked of whom."""

    def __init__(self, supervisor):
        self.supervisor = supervisor
        self.asked, self.answer = [], None
        self.fleet = Fleet(3, supervisor, table, self.ask)
        for index in range(3):
            self.fleet.note(str(index), True)

    def ask(self, service, verb, params):
        assert verb == "set"
        self.asked.append((service, params["cameras"]))
        if self.answer is not None:
            raise self.answer

    def until(self, condition):
        """Wait for what the processes do; there is no queue to wait on."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while not condition():
            assert time.monotonic() < deadline_s
            self.supervisor.poll()
            time.sleep(0.01)

    def gone(self, *cameras):
        return lambda: not {f"camera/{i}" for i in cameras} & set(self.supervisor.children)


@pytest.fixture
def bench(tmp_path):
    never = RestartPolicy(max_in_a_row=0)
    with Supervisor(list(table(3).values()), tmp_path, never) as supervisor:
        supervisor.start()
        yield Bench(supervisor)


def test_new_cameras_are_planned_for_when_all_are_there_and_not_before(bench):
    assert bench.fleet.set({"cameras": 5})["starting"] == [3, 4]
    bench.fleet.update()
    assert {"camera/3", "camera/4"} <= set(bench.supervisor.children)
    bench.fleet.note("3", True)
    bench.fleet.update()
    assert bench.asked == []
    assert bench.fleet.at_work == 3
    bench.fleet.note("4", True)
    bench.fleet.update()
    bench.fleet.update()
    assert bench.asked == [("planner", 5), ("simulator", 5)]
    assert bench.fleet.get({})["running"] == [0, 1, 2, 3, 4]
    # Should they crash, they come back as they are now.
    assert bench.supervisor.children["planner"].spec == table(5)["planner"]


def test_fewer_keep_the_places_until_the_others_are_gone(bench):
    assert bench.fleet.set({"cameras": 1})["ending"] == [1, 2]
    bench.fleet.update()
    assert bench.asked == [("planner", 1)]
    assert bench.fleet.at_work == 1
    bench.until(bench.gone(1, 2))
    bench.fleet.update()
    assert bench.asked[1:] == [("planner", 1), ("simulator", 1)]
    assert bench.fleet.get({})["ending"] == []


def test_one_that_is_ending_ends_before_it_is_started_anew(bench):
    bench.fleet.set({"cameras": 2})
    old = bench.supervisor.children["camera/2"]
    bench.fleet.set({"cameras": 3})
    bench.fleet.update()
    assert bench.supervisor.children["camera/2"] is old
    bench.until(bench.gone(2))
    bench.fleet.update()
    assert bench.supervisor.children["camera/2"].state == "running"


def test_a_camera_that_cannot_be_kept_alive_leaves_the_run_as_it_was(bench):
    bench.fleet.set({"cameras": BROKEN + 1})
    bench.fleet.update()
    bench.until(lambda: bench.supervisor.children[f"camera/{BROKEN}"].state == "failed")
    bench.fleet.update()
    told = bench.fleet.get({})
    assert (told["cameras"], told["ending"]) == (3, [3, 4, 5, 6, 7])
    assert "8 cameras are not to be had" in told["trouble"]
    bench.until(bench.gone(3, 4, 5, 6, 7))
    bench.fleet.update()
    assert bench.asked == [("planner", 3)]


def test_a_growth_that_the_simulator_refuses_is_taken_back_from_the_planner(bench):
    planned = []

    def ask(service, _, params):
        if service == "simulator":
            raise CommandFailed("no room")
        planned.append(params["cameras"])

    fleet = Fleet(3, bench.supervisor, table, ask)
    for index in range(4):
        fleet.note(str(index), True)
    fleet.set({"cameras": 4})
    fleet.update()
    fleet.update()
    assert planned == [4, 3]
    assert (fleet.wanted, fleet.at_work) == (3, 3)


@pytest.mark.parametrize("error", [NoReply("nobody"), CommandFailed("no")])
def test_giving_up_ends_neither_the_run_nor_the_planner(bench, error):
    bench.fleet.set({"cameras": BROKEN + 1})
    bench.fleet.update()
    bench.until(lambda: bench.supervisor.children[f"camera/{BROKEN}"].state == "failed")
    bench.answer = error
    bench.fleet.update()
    assert bench.fleet.get({})["cameras"] == 3
    assert f"may still plan for them: {error}" in bench.fleet.get({})["trouble"]


def test_what_the_planner_refuses_is_refused_and_changes_nothing(bench):
    bench.answer = CommandFailed("rings needs 2 cameras at least")
    with pytest.raises(CommandFailed, match="at least"):
        bench.fleet.set({"cameras": 1})
    assert bench.fleet.get({})["cameras"] == 3
    bench.fleet.set({"cameras": 4})
    bench.fleet.update()
    bench.fleet.note("3", True)
    bench.fleet.update()
    assert bench.fleet.get({})["cameras"] == 3
    assert "at least" in bench.fleet.get({})["trouble"]


def test_a_planner_that_is_not_there_is_asked_again(bench):
    bench.fleet.set({"cameras": 4})
    bench.fleet.update()
    bench.fleet.note("3", True)
    bench.answer = NoReply("nobody")
    bench.fleet.update()
    bench.answer = None
    bench.fleet.update()
    assert bench.asked == [("planner", 4), ("planner", 4), ("simulator", 4)]


@pytest.mark.parametrize("cameras", [0, 65, "many", 2.5])
def test_a_wrong_number_is_refused(bench, cameras):
    with pytest.raises(ValidationError):
        bench.fleet.set({"cameras": cameras})
    assert bench.fleet.get({})["cameras"] == 3
