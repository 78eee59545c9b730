"""What `encircle hz 'cams/*/cloud'` costs and whether it tells the truth.

Six cameras in one process send a depth cloud of 640 x 480 each, 15 times a second; `encircle hz`
runs as its users start it. Its processor time is that between its second and its last report. Then
the listener is stopped (SIGSTOP) for a second, as a slow one would be: the rate must not change.

    python benchmarks/inspecting.py [--seconds 10]
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import numpy as np
import psutil
from machine import describe

from schemas.camera import Intrinsics
from schemas.cloud import DepthCloud
from schemas.geometry import Pose
from schemas.topics import CAMERA_CLOUD
from services.runtime.bus import Bus
from services.runtime.router import router
from services.runtime.settings import BusSettings

CAMERAS, RATE_HZ, SIZE = 6, 15.0, (640, 480)
ENCIRCLE = (sys.executable, "-c", "from services.launcher.cli import main; main()")


def cloud(camera: int, tick: int, depth: np.ndarray) -> DepthCloud:
    """Return a cloud of a camera at an instant."""
    return DepthCloud.of(
        depth,
        t_ns=0,
        tick=tick,
        frame_id="world",
        camera=camera,
        pose=Pose(position=(0.0, 0.0, 0.0), orientation=(0.0, 0.0, 0.0, 1.0)),
        max_range_m=5.0,
        t_capture_ns=time.time_ns(),
        intrinsics=Intrinsics.from_vertical_fov(*SIZE, 0.8),
        depth_scale_m=0.001,
    )


def send(buses: list[Bus], stop: threading.Event) -> None:
    """Send a cloud from every camera at each instant, by the clock."""
    depth = np.random.default_rng(0).integers(500, 4000, SIZE[::-1]).astype("<u2")
    begin_s = time.monotonic()
    tick = 0
    while not stop.wait(max(0.0, begin_s + tick / RATE_HZ - time.monotonic())):
        for camera, bus in enumerate(buses):
            bus.publish(CAMERA_CLOUD, cloud(camera, tick, depth), camera=camera)
        tick += 1


def measure(endpoint: str, buses: list[Bus], seconds: float) -> str:
    """Run `encircle hz` and return the row."""
    command = [*ENCIRCLE, "hz", "cams/*/cloud", "--json", "--bus.connect", endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        seen = psutil.Process(process.pid)

        def report() -> list[dict]:
            return [json.loads(process.stdout.readline()) for _ in range(CAMERAS)]

        report(), report()
        spent_s, begin_s = sum(seen.cpu_times()[:2]), time.monotonic()
        sent = [meter(bus, camera).count for camera, bus in enumerate(buses)]
        while time.monotonic() - begin_s < seconds:
            rows = report()
        wall_s = time.monotonic() - begin_s
        share = (sum(seen.cpu_times()[:2]) - spent_s) / wall_s
        true_hz = [
            (meter(bus, camera).count - sent[camera]) / wall_s for camera, bus in enumerate(buses)
        ]
        os.kill(process.pid, signal.SIGSTOP)
        time.sleep(1.0)
        os.kill(process.pid, signal.SIGCONT)
        after = [report() for _ in range(2)][-1]
        process.send_signal(signal.SIGINT)
    printed = [row["rate_hz"] for row in rows]
    stalled = [row["rate_hz"] for row in after]
    return (
        f"{share:.1%} of a core; sent {np.mean(true_hz):.2f} Hz, printed {min(printed):.2f} to "
        f"{max(printed):.2f}; after a second's stop {min(stalled):.2f} to {max(stalled):.2f}, "
        f"lost {sum(row['lost'] for row in after)}, dropped here "
        f"{sum(row['dropped_here'] for row in after)}"
    )


def meter(bus: Bus, camera: int):
    """Return the sender's own count."""
    return bus.meters.of(CAMERA_CLOUD, CAMERA_CLOUD.key_for(camera), sent=True)


def main() -> None:
    """Print the row."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    print(describe("eclipse-zenoh", "msgpack", "numpy"))
    stop = threading.Event()
    with ExitStack() as stack:
        endpoint = stack.enter_context(router())
        settings = BusSettings(connect=endpoint)
        buses = [
            stack.enter_context(Bus(settings, "camera", str(camera))) for camera in range(CAMERAS)
        ]
        sender = threading.Thread(target=send, args=(buses, stop))
        sender.start()
        try:
            print(measure(endpoint, buses, seconds))
        finally:
            stop.set()
            sender.join()


if __name__ == "__main__":
    main()
