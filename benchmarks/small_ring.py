"""A small ring of cameras as `encircle run` starts it, and an ear on its bus."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, TypeVar

import psutil

from schemas.camera import CameraPose
from schemas.formation import Formation
from schemas.map import MapSummary
from schemas.metrics import Quality
from schemas.sim import SimClock
from schemas.topics import CAMERA_POSE, FORMATION, MAP_SUMMARY, QUALITY, SIM_CLOCK
from services.launcher.ports import free_port
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.reader import Received
from services.runtime.settings import BusSettings

CAMERAS = (0, 1, 2)
RATE_HZ = 10.0
FLAGS = (
    "--headless", "--no-viewer", "--forever", "--mode", "realtime", "--rate", str(RATE_HZ),
    "--cameras", str(len(CAMERAS)), "--resolution", "160x120", "--voxel-size", "0.02",
)  # fmt: skip
_KEPT = 4096
START_S = 180.0
"""How long the first whole instant may take on a busy machine."""
T = TypeVar("T")


class Instant(NamedTuple):
    """A summary of the map, as it was heard."""

    heard_s: float
    tick: int
    boot: str
    used: tuple[int, ...]

    @property
    def whole(self) -> bool:
        """Whether all cameras are in it."""
        return set(CAMERAS) <= set(self.used)


class Ear:
    """Hears what a run says of itself, on a thread of its own; all times are monotonic."""

    def __init__(self, endpoint: str) -> None:
        self.instants: deque[Instant] = deque(maxlen=_KEPT)
        self.f_scores: dict[int, float] = {}
        """By tick, at twice the resolution."""
        self.tick = 0
        self.boots: dict[str, dict[str, float]] = {}
        """Of each service, by its boots: when the first word was heard."""
        self.spoke_s: dict[str, float] = {}
        """When each service spoke last."""
        self.left_s: dict[str, float] = {}
        """When each service last left the bus."""
        self.counts: dict[str, int] = {}
        """Words of each service."""
        self._changed = threading.Condition()
        self._bus = Bus(BusSettings(connect=endpoint, shm_pool_mib=0), "inspector")
        self._loop = Loop(self._bus)
        self._loop.on(MAP_SUMMARY, self._on_summary, every=True)
        self._loop.on(QUALITY, self._on_quality, every=True)
        self._loop.on(SIM_CLOCK, self._on_clock)
        self._loop.on(FORMATION, self._on_word("planner"))
        for camera in CAMERAS:
            self._loop.on(CAMERA_POSE, self._on_word(f"camera/{camera}"), camera, every=True)
        for service in ("camera", "mapper", "planner"):
            self._loop.on_alive(service, self._on_alive(service))
        self._thread = threading.Thread(target=self._loop.run)

    def __enter__(self) -> "Ear":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.stop()
        self._thread.join()
        self._bus.close()

    def wait(self, found: Callable[[], T | None], timeout_s: float, what: str) -> T:
        """Wait until something is heard.

        Raises:
            TimeoutError: If it is not in time.
        """
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while (result := found()) is None:
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    raise TimeoutError(f"{what}: not within {timeout_s:g} s")
                self._changed.wait(left_s)
        return result

    def heard(self) -> list[Instant]:
        """Return the instants heard so far."""
        with self._changed:
            return list(self.instants)

    def first_good(self, since_s: float, tick: int, threshold: float) -> Instant | None:
        """Return the first whole instant heard since, not before a tick, of that F-score."""
        for instant in self.instants:
            is_new = instant.heard_s >= since_s and instant.tick >= tick
            if is_new and instant.whole and self.f_scores.get(instant.tick, -1.0) >= threshold:
                return instant
        return None

    def _on_summary(self, received: Received[MapSummary]) -> None:
        message, boot = received.message, received.envelope.boot
        self._note("mapper", boot)
        with self._changed:
            self.instants.append(
                Instant(time.monotonic(), message.tick, boot, message.cameras_used)
            )
            self._changed.notify_all()

    def _on_quality(self, received: Received[Quality]) -> None:
        with self._changed:
            self.f_scores[received.message.tick] = received.message.stamp_true[1].f_score
            while len(self.f_scores) > _KEPT:
                del self.f_scores[next(iter(self.f_scores))]
            self._changed.notify_all()

    def _on_clock(self, received: Received[SimClock]) -> None:
        self.tick = received.message.tick

    def _on_word(
        self, service: str
    ) -> Callable[[Received[CameraPose] | Received[Formation]], None]:
        return lambda received: self._note(service, received.envelope.boot)

    def _on_alive(self, service: str) -> Callable[[str, bool], None]:
        def note(instance: str, alive: bool) -> None:
            name = f"camera/{instance}" if service == "camera" else service
            if not alive:
                with self._changed:
                    self.left_s[name] = time.monotonic()
                    self._changed.notify_all()

        return note

    def _note(self, service: str, boot: str) -> None:
        with self._changed:
            self.spoke_s[service] = now_s = time.monotonic()
            self.boots.setdefault(service, {}).setdefault(boot, now_s)
            self.counts[service] = self.counts.get(service, 0) + 1
            self._changed.notify_all()


class Ring:
    """The processes of a run."""

    def __init__(self, launcher: subprocess.Popen[bytes], endpoint: str, folder: Path) -> None:
        self.launcher, self.endpoint, self.folder = launcher, endpoint, folder

    def processes(self) -> dict[str, psutil.Process]:
        """Return the services' processes by name, the launcher's, too."""
        found = {"launcher": psutil.Process(self.launcher.pid)}
        for each in found["launcher"].children():
            try:
                words = each.cmdline()
            except psutil.Error:
                continue
            module = next((word for word in words if word.startswith("services.")), "")
            name = module.removeprefix("services.").removeprefix("runtime.")
            if name == "camera":
                name = f"camera/{words[words.index('--camera') + 1]}"
            if name:
                found[name] = each
        return found

    def said(self) -> str:
        """Return what the launcher printed last."""
        return (self.folder / "run.txt").read_text(errors="replace")[-3000:]


@contextmanager
def small_ring(folder: Path, *flags: str) -> Iterator[Ring]:
    """Run a ring in a folder; nothing of it is left behind."""
    port = free_port()
    with (folder / "run.txt").open("wb") as said:
        launcher = subprocess.Popen(
            [
                sys.executable, "-c", "from services.launcher.cli import main; main()",
                "run", *FLAGS, "--port", str(port), *flags,
            ],
            cwd=folder, stdout=said, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
    ring = Ring(launcher, f"tcp/127.0.0.1:{port}", folder)
    try:
        yield ring
    finally:
        with contextlib.suppress(psutil.Error):
            for each in ring.processes().values():
                each.resume()
        launcher.send_signal(signal.SIGINT)
        try:
            launcher.wait(30)
        except subprocess.TimeoutExpired:
            os.killpg(launcher.pid, signal.SIGKILL)  # Its services die with it.
            launcher.wait()
