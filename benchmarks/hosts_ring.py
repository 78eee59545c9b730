"""A ring of cameras on five computers: who runs where, and what its map says of itself."""

import os
import signal
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from wire import DESK, SUBNET, Wire

from schemas.topics import MAP_SUMMARY
from services.launcher import authority
from services.launcher.processes import ProcessSpec, process_table
from services.launcher.settings import RunSettings
from services.runtime.bus import Bus
from services.runtime.guard import file_name
from services.runtime.settings import BusSettings

HOSTS = ("base", "left", "right", "maps", DESK)
CAMERAS = (0, 1, 2)
RATE_HZ = 10.0
PORT = 7447
T = TypeVar("T")


def host_of(name: str) -> str:
    """Return where a service runs: cameras on two computers, the mapper on one of its own."""
    match name:
        case "camera/0" | "camera/1":
            return "left"
        case "camera/2":
            return "right"
        case "mapper" | "evaluator":
            return "maps"
        case "launcher":
            return DESK
        case _:
            return "base"


def address_of(host: str) -> str:
    """Return where a host is."""
    return f"{SUBNET}.{HOSTS.index(host) + 1}"


@dataclass(frozen=True)
class Told:
    """An instant of the map, as the desk heard of it."""

    heard_s: float
    tick: int
    used: tuple[int, ...]
    latency_ms: float
    """From the first shutter to the map; the computers have one clock here."""


class Desk:
    """Hears what the ring says of itself."""

    def __init__(self, bus: Bus) -> None:
        self.told: deque[Told] = deque(maxlen=10_000)
        self._changed = threading.Condition()
        self._summaries = bus.every(MAP_SUMMARY)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        bus.presence.announce()

    def wait(self, found: Callable[[], T | None], timeout_s: float, what: str) -> T:
        """Wait until something was heard.

        Raises:
            TimeoutError: If it is not in time.
        """
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while (result := found()) is None:
                if (left_s := deadline_s - time.monotonic()) <= 0:
                    raise TimeoutError(f"{what}: not within {timeout_s:g} s")
                self._changed.wait(left_s)
        return result

    def since(self, begun_s: float) -> list[Told]:
        """Return what was told since then."""
        with self._changed:
            return [each for each in self.told if each.heard_s >= begun_s]

    def first_whole(self, since_s: float) -> Told | None:
        """Return the first instant since then that all cameras are in."""
        return next((each for each in self.since(since_s) if set(each.used) >= set(CAMERAS)), None)

    def _listen(self) -> None:
        for received in self._summaries:
            message = received.message
            with self._changed:
                self.told.append(
                    Told(time.monotonic(), message.tick, message.cameras_used, message.latency_ms)
                )
                self._changed.notify_all()


class HostsRing:
    """The wire, the processes on it, and the desk that listens."""

    def __init__(
        self, wire: Wire, processes: dict[str, subprocess.Popen[bytes]], folder: Path
    ) -> None:
        self.wire, self.processes, self._folder = wire, processes, folder
        self.desk: Desk

    def said(self) -> str:
        """Return the last that each process printed."""
        return "\n".join(
            f"{name}: {(self._folder / _log(name)).read_text(errors='replace')[-500:]}"
            for name in self.processes
        )


def certify(folder: Path) -> Path:
    """Make the certificates of all who take part, each for the address of its host."""
    authority.create(folder, days=1)
    cameras = tuple(f"camera/{camera}" for camera in CAMERAS)
    for role in ("router", "simulator", "planner", "mapper", "evaluator", "launcher", *cameras):
        authority.issue(folder, role, file_name(role), [address_of(host_of(role))], 1)
    return folder


@contextmanager
def hosts_ring(resolution: str, *, certs: Path | None = None, tcp: str = "") -> Iterator[HostsRing]:
    """Start a ring on computers of its own; nothing of it is left behind."""
    with tempfile.TemporaryDirectory() as path, Wire(HOSTS, Path(path), tcp=tcp) as wire:
        folder = Path(path)
        router = f"tcp/{wire.hosts['base'].address}:{PORT}"
        settings = RunSettings(
            cameras=len(CAMERAS), resolution=resolution, voxel_size=0.02, mode="realtime",
            rate=RATE_HZ, forever=True, viewer=False, headless=True,
        )  # fmt: skip
        ring = HostsRing(wire, {}, folder)
        try:
            for spec in process_table(settings, router):
                ring.processes[spec.name] = _start(spec, wire, folder, certs)
            joining = BusSettings(
                connect=router,
                listen=f"tcp/{wire.hosts[DESK].address}:0",
                shm_pool_mib=0,
                certs=certs,
            )
            with Bus(joining, "launcher") as bus:
                ring.desk = Desk(bus)
                yield ring
        finally:
            for process in ring.processes.values():
                process.send_signal(signal.SIGTERM)
            for process in ring.processes.values():
                try:
                    process.wait(10)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def _start(
    spec: ProcessSpec, wire: Wire, folder: Path, certs: Path | None
) -> subprocess.Popen[bytes]:
    host = wire.hosts[host_of(spec.name)]
    environment = os.environ | spec.env | {"ENCIRCLE_BUS_LISTEN": f"tcp/{host.address}:0"}
    if certs is not None:
        environment["ENCIRCLE_BUS_CERTS"] = str(certs)
    with (folder / _log(spec.name)).open("wb") as log:
        return subprocess.Popen(
            host.command(*spec.argv), env=environment, stdin=subprocess.DEVNULL, stdout=log,
            stderr=subprocess.STDOUT, cwd=folder,
        )  # fmt: skip


def _log(name: str) -> str:
    return name.replace("/", "-") + ".log"
