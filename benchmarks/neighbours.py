"""Bad neighbours on the bus of a running ring: one that floods, one that never reads.

The flood is a process that publishes clouds of 160 x 120 pixels under a camera's key of its own,
1000 a second, stamped as the instant at hand. The one that never reads subscribes to everything
and lets its buffer fill: zenoh's own thread stands still in it, while the link stays alive. Told
are the ring's rates and its processes' memory before, meanwhile and after.

    python benchmarks/neighbours.py [--seconds 15] [--json FILE]
"""

import argparse
import contextlib
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from machine import describe
from small_ring import CAMERAS, START_S, Ear, Ring, small_ring
from soak import look

from schemas.camera import Intrinsics
from schemas.cloud import DepthCloud
from schemas.geometry import Pose
from schemas.topics import CAMERA_CLOUD, SIM_CLOCK
from services.runtime.bus import Bus
from services.runtime.settings import BusSettings

FLOOD_HZ = 1000.0
STRANGER = len(CAMERAS)
WATCHED = ("mapper", *(f"camera/{camera}" for camera in CAMERAS))


def flood(endpoint: str) -> None:
    """Publish clouds that tell nothing, until a signal ends us."""
    optics = Intrinsics.from_vertical_fov(160, 120, 0.8)
    blind = np.zeros((120, 160), np.uint16)
    with Bus(BusSettings(connect=endpoint), "camera", str(STRANGER)) as bus:
        bus.presence.announce()
        with bus.latest(SIM_CLOCK) as clocks:
            clock = clocks.get(30.0).message
            due_s = began_s = time.monotonic()
            sent = 0
            while True:
                if sent % 16 == 0:
                    with contextlib.suppress(TimeoutError):
                        clock = clocks.get(0.0).message
                message = DepthCloud.of(
                    blind,
                    t_ns=clock.t_ns,
                    tick=clock.tick,
                    frame_id="world",
                    camera=STRANGER,
                    pose=Pose.from_matrix(np.eye(4)),
                    max_range_m=5.0,
                    t_capture_ns=time.time_ns(),
                    intrinsics=optics,
                    depth_scale_m=0.001,
                )
                bus.publish(CAMERA_CLOUD, message, camera=STRANGER)
                sent += 1
                if sent % 1000 == 0:
                    print(f"{sent / (time.monotonic() - began_s):.0f}", flush=True)
                due_s = max(due_s + 1.0 / FLOOD_HZ, time.monotonic() - 0.1)
                time.sleep(max(0.0, due_s - time.monotonic()))


def never_read(endpoint: str) -> None:
    """Subscribe to everything and read nothing, until a signal ends us."""
    import zenoh  # A stranger's program: it need not be one of ours.

    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("peer"))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("listen/endpoints", json.dumps(["tcp/127.0.0.1:0"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("**", zenoh.handlers.FifoChannel(1))
        signal.pause()
        del subscriber


NEIGHBOURS = {"flood": flood, "never_read": never_read}


def observe(ring: Ring, ear: Ear, seconds: float) -> dict[str, float]:
    """Return rates, Hz, and memory at the end, MB."""
    before = dict(ear.counts)
    began_s = time.monotonic()
    time.sleep(seconds)
    span_s = time.monotonic() - began_s
    processes = ring.processes()
    rates = {f"{name} Hz": (ear.counts[name] - before[name]) / span_s for name in WATCHED}
    whole = sum(i.whole and i.heard_s >= began_s for i in ear.heard()) / span_s
    memory = {f"{name} MB": look(processes[name]).memory / 1e6 for name in WATCHED}
    return {**rates, "whole instants Hz": whole, **memory}


def meet(ring: Ring, ear: Ear, name: str, seconds: float) -> dict[str, dict[str, float]]:
    """Let a neighbour in, and out again; return what was observed in each third."""
    seen = {"before": observe(ring, ear, seconds)}
    with subprocess.Popen(
        [sys.executable, __file__, "--be", name, "--endpoint", ring.endpoint],
        stdout=subprocess.PIPE,
    ) as neighbour:
        try:
            time.sleep(5.0)  # It starts, and a full buffer fills.
            seen["meanwhile"] = observe(ring, ear, seconds)
            seen["later"] = observe(ring, ear, seconds)
        finally:
            neighbour.kill()
        said = neighbour.communicate()[0].split()
    if said:
        seen["meanwhile"]["flood Hz"] = float(said[-1])
    time.sleep(5.0)
    seen["after"] = observe(ring, ear, seconds)
    return seen


def table(seen: dict[str, dict[str, float]]) -> Sequence[str]:
    """Return what was observed, a figure a line."""
    lines = [f"{'':20}" + "".join(f"{when:>12}" for when in seen)]
    for figure in dict.fromkeys(key for some in seen.values() for key in some):
        values = (f"{some[figure]:12.1f}" if figure in some else " " * 12 for some in seen.values())
        lines.append(f"{figure:20}" + "".join(values))
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    parser.add_argument("--be", choices=NEIGHBOURS, help=argparse.SUPPRESS)
    parser.add_argument("--endpoint", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.be:
        NEIGHBOURS[asked.be](asked.endpoint)
        return
    print(describe("eclipse-zenoh", "numpy"))
    with (
        tempfile.TemporaryDirectory() as folder,
        small_ring(Path(folder)) as ring,
        Ear(ring.endpoint) as ear,
    ):
        ear.wait(lambda: next((i for i in ear.heard() if i.whole), None), START_S, "a whole map")
        met = {name: meet(ring, ear, name, asked.seconds) for name in NEIGHBOURS}
    for name, seen in met.items():
        print("\n".join([name, *table(seen)]))
    if asked.json:
        asked.json.write_text(json.dumps(met, indent=1) + "\n")


if __name__ == "__main__":
    main()
