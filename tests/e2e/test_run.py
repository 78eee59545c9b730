"""`encircle run` as its users start it: real processes, from the first to the last."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(180)]

SMALL = ("--headless", "--resolution", "160x120", "--cameras", "3", "--voxel-size", "0.02")
TIMEOUT_S = 150


def start(tmp_path, *flags):
    """Start a run in a folder of its own, as its own process group."""
    return subprocess.Popen(
        [sys.executable, "-c", "from services.launcher.cli import main; main()", "run", *flags],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def finish(process):
    output, _ = process.communicate(timeout=TIMEOUT_S)
    return output


def wait_for(process, condition):
    """Wait for what other processes do; there is no queue to wait on."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not (result := condition()):
        assert process.poll() is None, process.stdout.read()
        assert time.monotonic() < deadline_s, "timed out"
        time.sleep(0.05)
    return result


def family(process):
    return psutil.Process(process.pid).children(recursive=True)


def wait_for_maps(process, tmp_path):
    """Wait until the mapper is at work; return the log that says so."""
    return wait_for(process, lambda: any(each.stat().st_size for each in logs(tmp_path, "mapper")))


def logs(tmp_path, name):
    return list(tmp_path.glob(f"runs/*/logs/{name}.log"))


def only_folder(tmp_path):
    (folder,) = (tmp_path / "runs").iterdir()
    return folder


def test_a_run_ends_with_a_report_a_map_and_a_chart(tmp_path):
    process = start(tmp_path, *SMALL, "--duration", "1", "--report", "out.json")
    output = finish(process)
    assert process.returncode == 0, output
    folder = only_folder(tmp_path)
    report = json.loads((tmp_path / "out.json").read_text())
    assert report == json.loads((folder / "report.json").read_text())
    assert report["ticks"] == report["perceptions"] == 15
    assert report["instants_scored"] == report["ticks"]
    assert report["missed_clouds"] == report["bad_messages"] == report["restarts"] == 0
    assert report["coverage_visible"]["mean"] > 0.5
    assert (folder / "map.ply").read_bytes().startswith(b"ply")
    assert (folder / "coverage.png").read_bytes().startswith(b"\x89PNG")
    assert "results in" in output


@pytest.mark.slow
def test_the_same_seed_gives_the_same_map(tmp_path):
    maps = []
    for name in ("a.npz", "b.npz"):
        process = start(tmp_path, *SMALL, "--duration", "0.5", "--save-map", name, "--no-evaluator")
        output = finish(process)
        assert process.returncode == 0, output
        maps.append((tmp_path / name).read_bytes())
    assert maps[0] == maps[1]


def test_ctrl_c_ends_a_run_with_its_report_and_leaves_no_process(tmp_path):
    process = start(tmp_path, *SMALL, "--forever")
    wait_for_maps(process, tmp_path)
    children = wait_for(process, lambda: family(process))
    process.send_signal(signal.SIGINT)
    output = finish(process)
    assert process.returncode == 0, output
    assert (only_folder(tmp_path) / "report.json").exists()
    assert not psutil.wait_procs(children, timeout=5)[1]


def test_a_killed_launcher_leaves_no_process(tmp_path):
    process = start(tmp_path, *SMALL, "--forever")
    wait_for_maps(process, tmp_path)
    children = wait_for(process, lambda: family(process))
    process.kill()
    process.wait()
    assert not psutil.wait_procs(children, timeout=5)[1]


def test_a_killed_camera_is_started_again_and_the_run_goes_on(tmp_path):
    process = start(tmp_path, *SMALL, "--duration", "6", "--no-evaluator")
    wait_for_maps(process, tmp_path)
    victim = wait_for(process, lambda: camera_process(process, 1))
    os.kill(victim.pid, signal.SIGKILL)
    output = finish(process)
    assert process.returncode == 0, output
    report = json.loads((only_folder(tmp_path) / "report.json").read_text())
    assert report["restarts"] == 1
    assert report["ticks"] == 90
    assert "camera/1 ended with signal 9; starting it again" in output


@pytest.mark.slow
def test_the_others_close_the_gap_of_a_killed_camera_until_it_is_back(tmp_path):
    process = start(tmp_path, *SMALL, "--forever", "--no-evaluator")

    def formations():
        texts = [log.read_text() for log in logs(tmp_path, "planner")]
        return [re.findall(r"formation of .*", text) for text in texts]

    def begun():
        return any("tick 0" in log.read_text() for log in logs(tmp_path, "simulator"))

    wait_for(process, begun)
    os.kill(camera_process(process, 1).pid, signal.SIGKILL)
    three, two = "formation of 3: cameras 0, 1, 2", "formation of 2: cameras 0, 2"
    wait_for(process, lambda: formations() == [[three, two, three]])
    process.send_signal(signal.SIGINT)
    assert finish(process)
    assert process.returncode == 0


def camera_process(process, index):
    words = ["services.camera", "--camera", str(index)]
    found = [each for each in family(process) if set(words) <= set(each.cmdline())]
    return found[0] if found else None


def test_a_wrong_object_ends_the_run_with_the_reason(tmp_path):
    process = start(tmp_path, *SMALL, "--object", "no_such.obj")
    output = finish(process)
    assert process.returncode == 1
    assert "no_such.obj" in output
    assert "simulator cannot be kept alive" in output


def test_a_wrong_scenario_ends_the_run_before_it_begins(tmp_path):
    Path(tmp_path / "x.toml").write_text("camera = 3\n")
    process = start(tmp_path, "--scenario", "x.toml")
    assert "x.toml: unknown key 'camera'; did you mean 'cameras'?" in finish(process)
    assert process.returncode == 2
    assert not (tmp_path / "runs").exists()
