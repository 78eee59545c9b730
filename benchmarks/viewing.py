"""What the viewer costs: processor time per frame, and what a run loses by it.

A frame has 50 000 voxels, all of which moved, six cameras with 640 x 480 depth images, the
formation, the path, and at every third frame the panel with its plots and pictures. The browser is
a process of its own that reads all it is told (or nothing), so that only the viewer's own time
counts: that of the thread which draws and that of viser's, which serves. With `--runs`, whole runs
with a viewer at which nobody looks: its part of the processor time bounds what the others lose.

    python benchmarks/viewing.py [--frames 100] [--runs 0]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from machine import describe

from schemas.camera import CameraInfo, CameraPose, Intrinsics
from schemas.cloud import DepthCloud
from schemas.formation import Formation
from schemas.geometry import Pose, Twist
from schemas.map import OCCUPIED, MapChanges
from services.kernels.rigid import look_at
from services.runtime.map_mirror import MapMirror
from services.viewer.admission import Admission
from services.viewer.pictures import pictures
from services.viewer.plots import NUM_SAMPLES
from services.viewer.studio import Studio
from services.viewer.web import Panel, Web
from services.viewer.web_guard import WebGuard

NUM_VOXELS, NUM_CAMERAS, PANEL_EVERY = 50_000, 6, 3
SHAPE = (120, 120, 80)
OPTICS = Intrinsics.from_vertical_fov(640, 480, np.radians(45))
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
HERE = Pose(position=(0, 0, 0), orientation=(0, 0, 0, 1))
ROOT = Path(__file__).parents[1]

# A browser's part of the wire: it connects, says where its camera is, and reads, or does not.
BROWSER = """
import sys, time, msgspec, viser
from viser._messages import ViewerCameraMessage
from websockets.sync.client import connect
port, reads = int(sys.argv[1]), sys.argv[2] == "reads"
camera = ViewerCameraMessage((1, 0, 0, 0), (1, 1, 1), 1, .01, 100, 600, 800, (0, 0, 0), (0, 0, 1))
with connect(f"ws://127.0.0.1:{port}", subprotocols=[f"viser-v{viser.__version__}"],
             compression=None, max_size=None) as page:
    page.send(msgspec.msgpack.encode(camera.as_serializable_dict()))
    while True:
        page.recv() if reads else time.sleep(1)
"""


def stamp(tick: int) -> dict[str, object]:
    return {"t_ns": tick * 66_666_667, "tick": tick, "frame_id": "world"}


def instant(studio: Studio, mirror: MapMirror, tick: int, rng: np.random.Generator) -> None:
    """Feed the studio what comes in one instant."""
    cells = rng.choice(int(np.prod(SHAPE)), NUM_VOXELS, replace=False)
    voxels = np.stack([*np.unravel_index(cells, SHAPE), np.full(NUM_VOXELS, OCCUPIED)], axis=1)
    mirror.apply(
        MapChanges.of(
            voxels.astype(np.int16), **stamp(tick), rev=tick, base_rev=0, resolution_m=0.01,
            origin=(-0.6, -0.6, -0.1), shape_voxels=SHAPE, pose=HERE,
        )
    )  # fmt: skip
    corners = []
    for camera in range(NUM_CAMERAS):
        angle = 0.01 * tick + camera * np.pi / 3
        pose = Pose.from_matrix(look_at((np.cos(angle), np.sin(angle), 0.6), (0, 0, 0.2)))
        who = {**stamp(tick), "camera": camera}
        depth = rng.integers(800, 1400, (480, 640)).astype(np.uint16)
        corners.append(pose.position)
        studio.newest.infos[camera] = CameraInfo(
            **who, intrinsics=OPTICS, depth_scale_m=0.001, min_range_m=0.1, max_range_m=5.0,
            noise="nguyen",
        )  # fmt: skip
        studio.newest.poses[camera] = CameraPose(**who, pose=pose, twist=STILL)
        studio.newest.clouds[camera] = DepthCloud.of(
            depth, **who, pose=pose, max_range_m=5.0, t_capture_ns=0, intrinsics=OPTICS,
            depth_scale_m=0.001,
        )  # fmt: skip
    studio.newest.formation = Formation(
        **stamp(tick), strategy="circle", centre=(0, 0, 0.2), radius_m=1.1, references=(),
        polygon=tuple(corners),
    )  # fmt: skip


def frames(num: int, browsers: tuple[str, ...]) -> tuple[float, float, float]:
    """Return the ms of a frame: on the drawing thread, of the whole process; and RSS growth, MB."""
    rng, studio, mirror = np.random.default_rng(0), Studio(), MapMirror()
    guard = WebGuard(Admission("", "127.0.0.1"))
    web = Web("127.0.0.1", 8090, guard, NUM_VOXELS, lambda *_: None, dark=False)
    pages = [
        subprocess.Popen([sys.executable, "-c", BROWSER, str(web.port), how]) for how in browsers
    ]
    while web.num_browsers < len(browsers):
        time.sleep(0.1)
    for step in range(NUM_SAMPLES):
        studio.plots.quality.add(0.1 * step, 99.0, 96.0, 98.0)
        studio.plots.fusing.add(0.1 * step, 15.0, 30.0)
    drawing, whole, resident = [], [], []
    for tick in range(1, num + 21):
        instant(studio, mirror, tick, rng)
        began_s, thread_s = time.process_time(), time.thread_time()
        studio.update_map(mirror)
        images = pictures(studio.newest)
        frame = studio.frame(web.options(), images)
        panel = Panel({}, f"tick {tick}", [], studio.plots, images)
        web.draw(frame, panel if tick % PANEL_EVERY == 0 else None)
        drawing.append(time.thread_time() - thread_s)
        threading.Event().wait(0.1)  # Viser's thread sends meanwhile.
        whole.append(time.process_time() - began_s)
        resident.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4096)
    for page in pages:
        page.kill()
        page.wait()
    web.close()
    medians = (1000 * float(np.median(times[20:])) for times in (drawing, whole))
    return *medians, (resident[-1] - resident[20]) / 1e6


def share(duration_s: float, *flags: str) -> float:
    """Return the viewer's part of a run's processor time; nobody looks."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [str(Path(sys.executable).with_name("encircle")), "run", "--headless"]
        command += ["--duration", str(duration_s), "--report", str(report), "--runs", folder]
        subprocess.run([*command, *flags], capture_output=True, check=True)
        spent = {name: of["cpu_s"] for name, of in json.loads(report.read_text())["time"].items()}
        return float(spent["viewer"] / sum(spent.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--runs", type=int, default=0)
    parser.add_argument("--port", default="7462")
    args = parser.parse_args()
    print(describe("viser", "numpy", "pydantic"))
    print(f"{NUM_VOXELS} voxels, {NUM_CAMERAS} depth images 640x480; median of {args.frames}")
    for name, browsers in {
        "one browser": ("reads",),
        "one that stopped reading": ("stalled",),
        "both": ("reads", "stalled"),
    }.items():
        drawing, whole, growth = frames(args.frames, browsers)
        print(
            f"  {name:<25} {drawing:5.1f} ms to draw, {whole:5.1f} ms of the process in all; "
            f"memory {growth:+.0f} MB"
        )
    if args.runs:
        shares = [share(10.0, "--port", args.port) for _ in range(args.runs)]
        print(
            f"encircle run, 10 s, nobody looks: {100 * np.median(shares):.1f} % of the processor "
            f"time of all its services is the viewer's; median of {args.runs}"
        )


if __name__ == "__main__":
    main()
