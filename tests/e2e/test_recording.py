"""Recorder, replay and remap as their users start them: real processes, also killed ones."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path

import pytest

from services.launcher.ports import free_port
from services.recorder.log_file import RecordedLog
from services.runtime.bus import Bus
from services.runtime.router import router
from services.runtime.settings import BusSettings
from services.runtime.tap import Tap
from tests.examples import EXAMPLES
from tests.integration.recording_world import a_cloud, packed, wait_until_heard

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(180)]

TARGET = EXAMPLES["target_pose"][1]
MAIN = (sys.executable, "-c", "from services.launcher.cli import main; main()")
SMALL = ("--headless", "--resolution", "160x120", "--cameras", "2", "--voxel-size", "0.02")


def start(folder: Path, *args: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*MAIN, *args], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def run(folder: Path, *args: str) -> str:
    done = subprocess.run(
        [*MAIN, *args], cwd=folder, capture_output=True, text=True, timeout=150, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def by_key(samples) -> dict[str, list[bytes]]:
    keys: dict[str, list[bytes]] = defaultdict(list)
    for sample in samples:
        keys[sample.key].append(sample.payload)
    return keys


@pytest.mark.parametrize("seconds", [1.3, 2.6])
def test_a_recorder_that_is_killed_loses_at_most_its_last_second(
    tmp_path: Path, seconds: float
) -> None:
    path = tmp_path / "a.mcap"
    sent: list[tuple[int, bytes]] = []
    with router() as endpoint, Bus(BusSettings(connect=endpoint), "simulator") as bus:
        recorder = start(tmp_path, "record", str(path), "--bus.connect", endpoint)
        try:
            wait_until_heard(bus, "target/pose")
            pace, end_s = threading.Event(), time.monotonic() + seconds
            while time.monotonic() < end_s:
                payload = packed(TARGET, len(sent), "simulator")
                sent.append((time.time_ns(), payload))
                bus.republish("target/pose", payload)
                if len(sent) % 20 == 0:
                    bus.republish("cams/0/cloud", packed(a_cloud(len(sent)), len(sent), "camera/0"))
                pace.wait(0.004)
        finally:
            os.kill(recorder.pid, signal.SIGKILL)
            killed_ns = time.time_ns()
            recorder.communicate(timeout=30)
    with RecordedLog(path) as log:
        kept = [record.payload for record in log if record.key == "target/pose"]
        assert "killed" in log.lost[0]
    assert kept == [payload for _, payload in sent][: len(kept)]
    due = [payload for sent_ns, payload in sent if sent_ns < killed_ns - 1_000_000_000]
    assert len(kept) >= len(due) > 10


def test_a_run_is_recorded_replayed_and_remapped_to_the_same_map(tmp_path: Path) -> None:
    port = str(free_port())
    output = run(
        tmp_path, "run", *SMALL, "--duration", "1", "--port", port, "--no-evaluator",
        "--no-viewer", "--record", "a.mcap", "--save-map", "live.ply",
    )  # fmt: skip
    assert re.search(r"recorded \d+ samples, .* 0 dropped, 0 lost", output), output
    with RecordedLog(tmp_path / "a.mcap") as log:
        recorded = by_key(log)
        assert log.lost == []
    for key in ("cams/1/cloud", "map/changes"):
        assert len(recorded[key]) >= 15  # Lockstep asks again for what may be lost.
    assert recorded["map/full"]
    assert recorded["cams/0/info"]

    output = run(tmp_path, "remap", "a.mcap", "--out", "again.ply")
    assert "30 clouds of 15 instants" in output
    assert (tmp_path / "again.ply").read_bytes() == (tmp_path / "live.ply").read_bytes()
    output = run(tmp_path, "remap", "a.mcap", "--out", "fine.ply", "--voxel-size", "0.01")
    assert "of 0.01 m" in output
    assert (tmp_path / "fine.ply").stat().st_size > 2 * (tmp_path / "live.ply").stat().st_size

    with router() as endpoint, Bus(BusSettings(connect=endpoint), "launcher") as bus:
        flags = ("--bus.connect", endpoint, "--rate", "4", "--delay-s", "2")
        replay = start(tmp_path, "replay", "a.mcap", *flags)
        with Tap(bus, ["**"]) as tap:
            log_text, _ = replay.communicate(timeout=100)
        assert replay.returncode == 0, log_text
        said = []
        while tap.waiting_bytes:
            said.append(tap.get(0))
    again = by_key(sample for sample in said if sample.key != "metrics/replay")
    assert again.keys() == recorded.keys() - {"map/full"}
    for key, payloads in again.items():
        # Links drop what a busy receiver does not take: nothing else may be missing, or come.
        rest = iter(recorded[key])
        assert all(payload in rest for payload in payloads), key
        assert len(payloads) >= len(recorded[key]) // 2, key


def test_what_cannot_be_recorded_or_replayed_ends_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"not an MCAP file, but it is somebody's")
    with router() as endpoint:
        for args, says in (
            (("record", "a.mcap"), "a.mcap exists; give another name, or --overwrite"),
            (("replay", "a.mcap"), "begins with b'not an M': no MCAP file"),
        ):
            process = start(tmp_path, *args, "--bus.connect", endpoint)
            output, _ = process.communicate(timeout=60)
            assert process.returncode == 2
            assert says in output
            assert "Traceback" not in output
    assert (tmp_path / "a.mcap").read_bytes().startswith(b"not an MCAP")
