"""The commands that look at a bus, as processes beside a whole run."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300)]

TIMEOUT_S = 120
ENCIRCLE = (sys.executable, "-c", "from services.launcher.cli import main; main()")
SMALL = ("--headless", "--resolution", "160x120", "--cameras", "2", "--voxel-size", "0.02")


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory):
    """Where the router of a run listens in which instants are fused."""
    with subprocess.Popen(
        [*ENCIRCLE, "run", *SMALL, "--forever"],
        cwd=tmp_path_factory.mktemp("run"),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            said = ""
            deadline_s = time.monotonic() + TIMEOUT_S
            while " perceptions/s" not in said:
                line = process.stdout.readline()
                assert line, said
                assert time.monotonic() < deadline_s, said
                said += line
            yield re.search(r"router at (\S+),", said)[1]
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)


def look(endpoint, *args, **popen):
    return subprocess.Popen(
        [*ENCIRCLE, *args, "--bus.connect", endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        **popen,
    )


def finish(process):
    out, err = process.communicate(timeout=TIMEOUT_S)
    return process.returncode, out.splitlines(), err


def test_doctor_finds_a_whole_run_well(endpoint):
    code, lines, err = finish(look(endpoint, "doctor", "--json"))
    verdicts = [json.loads(line) for line in lines]
    assert code == 0, (lines, err)
    good = {each["about"] for each in verdicts if each["level"] == "good"}
    assert good >= {"router", "services", "rates", "shared memory", "clocks", "versions"}


def test_hz_counts_by_the_tick_and_ends_well_at_ctrl_c(endpoint):
    with look(endpoint, "hz", "cams/*/cloud", "sim/clock", "--json") as process:
        rows = [json.loads(process.stdout.readline()) for _ in range(6)]
        process.send_signal(signal.SIGINT)
        code, _, err = finish(process)
    assert (code, err) == (0, "")
    rates = {row["key"]: row["rate_hz"] for row in rows}
    assert set(rates) == {"cams/0/cloud", "cams/1/cloud", "sim/clock"}
    assert rates["cams/0/cloud"] == pytest.approx(rates["cams/1/cloud"], rel=0.2)
    assert all(row["lost"] == row["dropped_here"] == 0 for row in rows)


def test_echo_into_a_pipe_that_closes_ends_quietly(endpoint):
    with look(endpoint, "echo", "formation.radius_m") as process:
        assert float(process.stdout.readline()) > 0
        process.stdout.close()
        assert process.wait(TIMEOUT_S) == 0
        assert process.stderr.read() == ""


def test_list_names_every_sender(endpoint):
    code, lines, err = finish(look(endpoint, "list", "--json"))
    rows = {row["key"]: row for row in map(json.loads, lines)}
    assert code == 0, err
    for key, sender in (
        ("cams/1/cloud", "camera/1"),
        ("map/changes", "mapper/0"),
        ("metrics/quality", "evaluator/0"),
        ("sim/state", "simulator/0"),
    ):
        assert rows[key]["sender"] == sender
        assert rows[key]["rate_hz"] > 0
