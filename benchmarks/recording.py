"""What a recorder costs beside six cameras at 15 Hz, how fast a replay can be, and a remapping.

A short run of six 640 x 480 cameras is recorded once. Its instants are then said again and again,
at 15 Hz sharp, by one process, while `encircle record` records them anew: its share of a core is
CPU time over wall time, as it reports both. The replay is the file as fast as it goes, into one
listener; the remapping is `encircle remap` on it.

    python benchmarks/recording.py [--seconds 20]
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from subprocess import DEVNULL

from machine import describe

from schemas.codec import unpack
from schemas.topics import SERVICE_STATUS
from services.launcher.ports import free_port
from services.recorder.log_file import RecordedLog
from services.runtime.bus import Bus
from services.runtime.router import router
from services.runtime.settings import BusSettings
from services.runtime.tap import Tap

ENCIRCLE = (sys.executable, "-c", "from services.launcher.cli import main; main()")
DT_S = 1 / 15


def encircle(*args: str) -> None:
    """Run a command to its end."""
    subprocess.run([*ENCIRCLE, *args], check=True, stdout=DEVNULL, stderr=DEVNULL)


def instants(path: Path) -> list[list[tuple[str, bytes]]]:
    """Read what was said in each instant; what is said once a second is left out."""
    by_tick: dict[int, list[tuple[str, bytes]]] = defaultdict(list)
    with RecordedLog(path) as log:
        wanted = [key for key in log.channels if not key.startswith(("metrics/", "map/full"))]
        for record in log.records(wanted=wanted.__contains__):
            by_tick[int(unpack(record.payload)["tick"])].append((record.key, record.payload))
    clouds = [
        [key for key, _ in said].count("cams/0/cloud") == 1 and len(said) > 20
        for said in by_tick.values()
    ]
    return [said for said, whole in zip(by_tick.values(), clouds, strict=True) if whole]


def cost_of_recording(source: Path, target: Path, seconds: float) -> str:
    """Record what is said at 15 Hz; return the figures."""
    said = instants(source)
    with RecordedLog(source) as log:
        about = log.metadata["settings"]["run"]
    keys = {key for instant in said for key, _ in instant}
    with (
        router() as endpoint,
        Bus(BusSettings(connect=endpoint, shm_pool_mib=64), "replay") as bus,
        bus.latest(SERVICE_STATUS) as beats,
    ):
        for key in keys:
            bus.prepare(key)
        flags = ("--bus.connect", endpoint, "--about", about)
        recorder = subprocess.Popen([*ENCIRCLE, "record", str(target), *flags], stderr=DEVNULL)
        try:
            while beats.get(60).message.service != "recorder":
                pass
            before = beats.get(60).message
            due_s, end_s, num = time.monotonic(), time.monotonic() + seconds, 0
            slips = 0
            while due_s < end_s:
                for key, payload in said[num % len(said)]:
                    bus.republish(key, payload)
                num, due_s = num + 1, due_s + DT_S
                left_s = due_s - time.monotonic()
                slips += left_s < 0
                time.sleep(max(0.0, left_s))
            last_s = time.monotonic()
            state = bus.request("recorder", "get")
            after = beats.get(60).message
            while time.monotonic() - last_s < 1.5:
                after = beats.get(60).message
        finally:
            recorder.send_signal(signal.SIGTERM)
            recorder.wait(30)
    share = (after.cpu_s - before.cpu_s) / seconds
    with RecordedLog(target) as log:
        num_clouds = sum(c.num_records for k, c in log.channels.items() if k.endswith("/cloud"))
        raw = sum(len(payload) for instant in said for _, payload in instant) / len(said)
    return (
        f"recorder: {share:.0%} of a core, {after.rss_bytes / 1e6:.0f} MB of memory; "
        f"{raw * 15 / 1e6:.0f} MB/s in, {target.stat().st_size / seconds / 1e6:.0f} MB/s to disk\n"
        f"  {num} instants, {num_clouds} of {6 * num} clouds kept, "
        f"{sum(state['dropped'].values())} dropped, {slips} instants said late"
    )


def rate_of_replay(path: Path) -> str:
    """Replay as fast as it goes; return the figures."""
    with (
        RecordedLog(path) as log,
        router() as endpoint,
        Bus(BusSettings(connect=endpoint), "launcher") as bus,
        Tap(bus, ["**"], 8 << 30) as tap,
    ):
        seconds = (log.end_ns - log.start_ns) * 1e-9
        flags = ("--rate", "1000", "--bus.connect", endpoint, "--bus.shm-pool-mib", "256")
        encircle("replay", str(path), *flags)
        samples = []
        while tap.waiting_bytes:
            samples.append(tap.get(0))
        samples = [sample for sample in samples if not sample.key.startswith("metrics/")]
        took_s = (samples[-1].received_ns - samples[0].received_ns) * 1e-9
        num_bytes = sum(len(sample.payload) for sample in samples)
        num = sum(
            channel.num_records
            for key, channel in log.channels.items()
            if not key.startswith(("metrics/", "map/full"))
        )
    return (
        f"replay: {seconds / took_s:.1f} x real time, {num_bytes / took_s / 1e6:.0f} MB/s; "
        f"{len(samples)} of {num} samples heard"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    print(describe("mcap", "lz4", "eclipse-zenoh", "numpy"))
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        run, again, figures = Path("run.mcap"), Path("again.mcap"), Path("figures.json")
        encircle(
            "run", "--headless", "--duration", "4", "--no-evaluator", "--no-viewer",
            "--port", str(free_port()), "--record", str(run),
        )  # fmt: skip
        print(cost_of_recording(run, again, seconds))
        print(rate_of_replay(again))
        encircle("remap", str(again), "--voxel-size", "0.01", "--json", str(figures))
        found = json.loads(figures.read_text())
        by_cpu = found["recorded_s"] / found["cpu_s"]
        print(
            f"remap: {found['times_real_time']:.1f} x real time at 1 cm, {by_cpu:.1f} x by CPU "
            f"time; {found['clouds']} clouds of {found['instants']} instants"
        )


if __name__ == "__main__":
    main()
