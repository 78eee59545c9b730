"""Eight services on four computers, whose cables are pulled at random: do all find all again?

Network namespaces with a wire between them (`wire.py`): 20 ms, 1 % loss, 50 Mbit/s, mTLS on every
link. One computer, in a third of the trials two, is cut off for a random time; then it is waited
until every service hears every other one again. Whom it takes long, or for ever, is printed with
its name: a pair that is deaf to each other does not show anywhere else. Linux, root.

    python benchmarks/cuts.py [--cuts 20] [--seconds 1 12] [--seed 0] [--json FILE]

The exit code is 1 if somebody was not found again within a minute.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from machine import describe
from wire import Quality, Wire

from schemas.topics import SERVICE_STATUS
from services.launcher import authority
from services.runtime.bus import Bus
from services.runtime.guard import file_name
from services.runtime.loop import Loop
from services.runtime.reader import Received
from services.runtime.settings import BusSettings

HOSTS = ("base", "left", "right", "maps")
NUM_PEERS = 8
LINK = Quality(delay_s=0.02, loss=0.01, rate_bit_s=50e6)
PATIENCE_S = 60.0
FRESH_S = 2.5
"""Services speak once a second."""


@dataclass(frozen=True)
class Cut:
    """Computers that were cut off, and when all heard all again."""

    hosts: tuple[str, ...]
    seconds: float
    again_s: float | None
    """From when the cable was back; None: not within a minute."""
    deaf: list[tuple[int, int]]
    """Who then did not hear whom."""


def host_of(peer: int) -> str:
    """Return where a service runs."""
    return HOSTS[peer % len(HOSTS)]


def listen(peer: int, settings: BusSettings, file: Path) -> None:
    """Be one of the services: speak as all do, and write down whom we have heard when."""
    heard: dict[str, float] = {}

    def note(received: Received) -> None:
        heard[received.message.instance] = time.monotonic()

    def write() -> None:
        file.with_suffix(".new").write_text(json.dumps(heard))
        file.with_suffix(".new").replace(file)

    with Bus(settings, "camera", str(peer)) as bus:
        loop = Loop(bus)
        loop.on(SERVICE_STATUS, note, every=True)
        loop.every(0.1, write)
        loop.run()


@contextmanager
def services(wire: Wire, folder: Path) -> Iterator[None]:
    """Run the router and the services, each on its computer."""
    router, certs = f"tcp/{wire.hosts['base'].address}:7447", folder / "certs"
    authority.create(certs, days=1)
    roles = {f"camera/{peer}": host_of(peer) for peer in range(NUM_PEERS)} | {"router": "base"}
    for role, host in roles.items():
        authority.issue(certs, role, file_name(role), [wire.hosts[host].address], 1)
    environment = os.environ | {"ENCIRCLE_BUS_CERTS": str(certs)}
    argv = [sys.executable, "-m", "services.runtime.router", "--listen", router]
    processes = [subprocess.Popen(wire.hosts["base"].command(*argv), env=environment)]
    for peer in range(NUM_PEERS):
        where = wire.hosts[host_of(peer)]
        argv = [
            sys.executable, __file__, "--peer", str(peer), "--file", str(folder / f"{peer}.json"),
            "--router", router, "--listen", f"tcp/{where.address}:0", "--certs", str(certs),
        ]  # fmt: skip
        processes.append(subprocess.Popen(where.command(*argv), env=environment))
    try:
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGKILL)
        for process in processes:
            process.wait()


def deaf(folder: Path) -> list[tuple[int, int]]:
    """Return who does not hear whom now."""
    now_s, found = time.monotonic(), []
    for peer in range(NUM_PEERS):
        path = folder / f"{peer}.json"
        heard = json.loads(path.read_text()) if path.exists() else {}
        found += [
            (peer, other)
            for other in range(NUM_PEERS)
            if other != peer and now_s - heard.get(str(other), 0.0) > FRESH_S
        ]
    return found


def wait(folder: Path) -> float | None:
    """Wait until all hear all; return how long it took, None if it did not come about."""
    begun_s = time.monotonic()
    while deaf(folder):
        if time.monotonic() - begun_s > PATIENCE_S:
            return None
        threading.Event().wait(0.05)
    return time.monotonic() - begun_s


def trials(num_cuts: int, seconds: tuple[float, float], seed: int) -> Iterator[Cut]:
    """Pull cables."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as path, Wire(HOSTS, Path(path)) as wire:
        folder = Path(path)
        with services(wire, folder):
            if wait(folder) is None:
                raise TimeoutError(f"they never met: {deaf(folder)}")
            wire.set(dict.fromkeys(HOSTS, LINK))
            for _ in range(num_cuts):
                time.sleep(rng.uniform(3.0, 6.0))
                hosts = tuple(rng.sample(HOSTS, 2 if rng.random() < 1 / 3 else 1))
                length_s = rng.uniform(*seconds)
                wire.cut(*hosts)
                time.sleep(length_s)
                wire.cut()
                yield Cut(hosts, length_s, wait(folder), deaf(folder))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--seconds", type=float, nargs=2, default=(1.0, 12.0))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    for name in ("peer", "file", "router", "listen", "certs"):
        parser.add_argument(f"--{name}", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.peer is not None:
        settings = BusSettings(
            connect=asked.router, listen=asked.listen, certs=asked.certs, shm_pool_mib=0
        )
        listen(int(asked.peer), settings, Path(asked.file))
        return
    print(describe("eclipse-zenoh"))
    done = []
    for cut in trials(asked.cuts, tuple(asked.seconds), asked.seed):
        done.append(cut)
        result = "NEVER" if cut.again_s is None else f"{cut.again_s:.1f} s after"
        print(f"{', '.join(cut.hosts):12} off for {cut.seconds:4.1f} s: all again {result}", end="")
        print(f"  deaf: {cut.deaf}" if cut.again_s is None else "", flush=True)
    found = [cut.again_s for cut in done if cut.again_s is not None]
    if found:
        p50, p95 = np.percentile(found, (50, 95))
        print(f"{len(found)} of {len(done)} found all; p50 {p50:.1f} s, p95 {p95:.1f} s", end="")
        print(f", at most {max(found):.1f} s")
    if asked.json:
        asked.json.write_text(json.dumps([asdict(cut) for cut in done], indent=1) + "\n")
    sys.exit(len(found) < len(done))


if __name__ == "__main__":
    main()
