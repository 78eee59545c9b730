"""The supervisor against real processes: restarts, give-up, stop, no orphans."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from services.launcher.processes import ProcessSpec
from services.launcher.supervisor import RestartPolicy, Supervisor, tail

pytestmark = pytest.mark.unit

TIMEOUT_S = 10.0
AT_ONCE = RestartPolicy(first_delay_s=0.0, max_in_a_row=2)

STUBBORN = "import signal, time; signal.signal(15, signal.SIG_IGN); print('up'); time.sleep(60)"


def python(name, code):
    return ProcessSpec(name, (sys.executable, "-I", "-S", "-u", "-c", code))


def sleeper(name="sleeper"):
    return ProcessSpec(name, ("sleep", "60"))


def wait_for(condition):
    """Wait for what another process does; there is no queue to wait on."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not (result := condition()):
        assert time.monotonic() < deadline_s, "timed out"
        time.sleep(0.01)
    return result


def is_running(pid):
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rsplit(")", 1)[1].split()[0] != "Z"


def test_what_is_started_runs_and_what_is_stopped_does_not(tmp_path):
    with Supervisor([sleeper("a"), sleeper("b")], tmp_path) as supervisor:
        supervisor.start()
        pids = [child.pid for child in supervisor.children.values()]
        assert all(is_running(pid) for pid in pids)
        assert supervisor.poll() == []
    assert not any(is_running(pid) for pid in pids)


def test_a_killed_process_is_started_again_and_counted(tmp_path):
    with Supervisor([sleeper()], tmp_path, AT_ONCE) as supervisor:
        supervisor.start()
        child = supervisor.children["sleeper"]
        first = child.pid
        os.kill(first, signal.SIGKILL)
        (crash,) = wait_for(supervisor.poll)
        assert str(crash) == "sleeper ended with signal 9; starting it again"
        supervisor.poll()
        assert child.restarts == supervisor.restarts == 1
        assert child.pid not in (None, first)


def test_what_crashes_again_and_again_is_given_up_and_its_log_shown(tmp_path):
    broken = python("broken", "raise SystemExit('no such thing')")
    with Supervisor([broken], tmp_path, AT_ONCE) as supervisor:
        supervisor.start()
        crashes = []
        while not (crashes and crashes[-1].given_up):
            crashes += wait_for(supervisor.poll)
        assert [crash.given_up for crash in crashes] == [False, False, True]
        assert supervisor.children["broken"].state == "failed"
        assert crashes[-1].log_tail.splitlines() == ["no such thing"] * 3


def test_wrong_settings_are_not_tried_again(tmp_path):
    with Supervisor([python("x", "raise SystemExit(2)")], tmp_path, AT_ONCE) as supervisor:
        supervisor.start()
        (crash,) = wait_for(supervisor.poll)
        assert crash.given_up
        assert supervisor.restarts == 0


def test_a_process_that_ends_by_itself_is_missed_however_well_it_ends(tmp_path):
    with Supervisor([python("done", "pass")], tmp_path, AT_ONCE) as supervisor:
        supervisor.start()
        (crash,) = wait_for(supervisor.poll)
        assert (crash.name, crash.exit_code, crash.given_up) == ("done", 0, False)
        wait_for(lambda: supervisor.poll() or supervisor.restarts == 1)


def test_a_restart_waits_for_its_delay(tmp_path):
    patient = RestartPolicy(first_delay_s=3600.0, max_delay_s=3600.0)
    with Supervisor([python("x", "raise SystemExit(1)")], tmp_path, patient) as supervisor:
        supervisor.start()
        wait_for(supervisor.poll)
        assert supervisor.poll() == []
        assert supervisor.children["x"].state == "waiting"


def test_delays_grow_up_to_a_limit():
    policy = RestartPolicy(first_delay_s=0.1, max_delay_s=8.0)
    delays_s = [policy.delay_s(n) for n in range(1, 7)]
    assert delays_s == pytest.approx([0.1, 0.3, 0.9, 2.7, 8.0, 8.0])


def test_one_that_ignores_the_request_to_end_is_killed(tmp_path):
    with Supervisor([python("stubborn", STUBBORN)], tmp_path) as supervisor:
        supervisor.start()
        wait_for(lambda: tail(supervisor.log_path("stubborn")) == "up")
        pid = supervisor.children["stubborn"].pid
        began_s = time.monotonic()
    assert 1.9 < time.monotonic() - began_s < 4
    assert not is_running(pid)


def test_a_recorder_is_given_the_time_to_finish_its_file(tmp_path, monkeypatch):
    monkeypatch.setattr("services.launcher.supervisor.TERMINATE_TIMEOUT_S", 0.1)
    finishing = (
        "import signal, time\n"
        "def finish(*_):\n    time.sleep(0.5)\n    print('whole')\n    raise SystemExit(0)\n"
        "signal.signal(15, finish)\nprint('up')\ntime.sleep(60)"
    )
    specs = [python("recorder", finishing), python("stubborn", STUBBORN)]
    with Supervisor(specs, tmp_path) as supervisor:
        supervisor.start()
        for name in supervisor.children:
            wait_for(lambda name=name: tail(supervisor.log_path(name)) == "up")
        began_s = time.monotonic()
    assert tail(supervisor.log_path("recorder")).endswith("whole")
    assert supervisor.children["stubborn"].process.returncode == -signal.SIGKILL
    assert time.monotonic() - began_s < 10


def test_grandchildren_are_ended_too(tmp_path):
    spawn = "import subprocess; p = subprocess.Popen(['sleep', '60']); print(p.pid); p.wait()"
    with Supervisor([python("parent", spawn)], tmp_path) as supervisor:
        supervisor.start()
        grandchild = int(wait_for(lambda: tail(supervisor.log_path("parent"))))
        assert is_running(grandchild)
    wait_for(lambda: not is_running(grandchild))


def test_children_read_their_environment_and_nothing_from_the_terminal(tmp_path):
    code = "import os, sys; print(os.environ['WHAT'], repr(sys.stdin.read()))"
    spec = ProcessSpec("x", python("x", code).argv, env={"WHAT": "yes"})
    with Supervisor([spec], tmp_path) as supervisor:
        supervisor.start()
        assert wait_for(lambda: tail(supervisor.log_path("x"))) == "yes ''"


@pytest.mark.skipif(sys.platform != "linux", reason="the parent's death is a signal on Linux only")
def test_children_die_with_a_launcher_that_is_killed(tmp_path):
    code = f"""
import time
from pathlib import Path
from services.launcher.processes import ProcessSpec
from services.launcher.supervisor import Supervisor
with Supervisor([ProcessSpec("x", ("sleep", "60"))], Path({str(tmp_path)!r})) as supervisor:
    supervisor.start()
    print(supervisor.children["x"].pid, flush=True)
    time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as launcher:
        orphan = int(launcher.stdout.readline())
        wait_for(lambda: Path(f"/proc/{orphan}/cmdline").read_bytes().startswith(b"sleep"))
        launcher.kill()
    wait_for(lambda: not is_running(orphan))


def test_one_more_is_started_and_one_that_is_ended_is_forgotten_and_not_missed(tmp_path):
    with Supervisor([sleeper("a")], tmp_path, AT_ONCE) as supervisor:
        supervisor.start()
        supervisor.add(sleeper("b"))
        a, b = (supervisor.children[name].pid for name in "ab")
        assert is_running(b)
        supervisor.end("b")
        assert wait_for(lambda: supervisor.poll() or list(supervisor.children) == ["a"]) is True
        assert is_running(a)
        assert not is_running(b)
        supervisor.add(sleeper("b"))
        assert supervisor.children["b"].pid not in (None, b)


def test_one_that_ignores_that_it_shall_end_is_killed_while_the_others_go_on(tmp_path):
    with Supervisor([sleeper("a"), python("b", STUBBORN)], tmp_path) as supervisor:
        supervisor.start()
        wait_for(lambda: tail(supervisor.log_path("b")) == "up")
        supervisor.end("b")
        assert supervisor.children["b"].state == "ending"
        wait_for(lambda: supervisor.poll() or "b" not in supervisor.children)
        assert supervisor.children["a"].state == "running"
