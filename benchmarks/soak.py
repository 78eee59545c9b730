"""Let a ring of cameras run for long: does any process grow?

A ring of three cameras runs in real time beside its evaluator. Every two seconds each process is
looked at: memory that is its own (USS, unique set size: nothing that is shared), open files,
sockets, threads. After the warm-up the median of the first quarter is held against that of the
last: 5 % more are allowed, and a few MB, which is what an allocator takes at once.

    python benchmarks/soak.py [--seconds 3600] [--warm-up 30] [--json FILE]

The exit code is 1 if something grew, or the map stood still.
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import psutil
from machine import describe
from small_ring import RATE_HZ, START_S, Ear, small_ring

PERIOD_S = 2.0
ALLOWED_SHARE = 0.05
ALLOWED_BYTES = 4 << 20
"""An allocator's steps: numba's and zenoh's arenas take a few MB at a time."""
COUNTS = ("files", "sockets", "threads")


@dataclass(frozen=True)
class Look:
    """One process at one time."""

    memory: int
    files: int
    sockets: int
    threads: int


@dataclass(frozen=True)
class Growth:
    """One process between the first and the last quarter; medians."""

    name: str
    first: Look
    last: Look

    @property
    def faults(self) -> list[str]:
        """What grew more than is allowed."""
        more = self.last.memory - self.first.memory
        allowed = max(ALLOWED_SHARE * self.first.memory, ALLOWED_BYTES)
        found = [f"{more / 1e6:+.1f} MB"] if more > allowed else []
        for what in COUNTS:
            step = getattr(self.last, what) - getattr(self.first, what)
            found += [f"{step:+d} {what}"] if step > 0 else []
        return found


def look(process: psutil.Process) -> Look:
    """Count what a process has now."""
    sockets = files = 0
    for entry in Path(f"/proc/{process.pid}/fd").iterdir():
        try:
            is_socket = str(entry.readlink()).startswith("socket:")
        except FileNotFoundError:
            continue
        sockets, files = sockets + is_socket, files + (not is_socket)
    return Look(process.memory_full_info().uss, files, sockets, process.num_threads())


def median_of(looks: list[Look]) -> Look:
    """Return the median of each figure."""
    columns = zip(*(asdict(each).values() for each in looks), strict=True)
    return Look(*(int(np.median(column)) for column in columns))


def soak(seconds: float, warm_up_s: float, said: dict[str, float]) -> list[Growth]:
    """Run a ring and look at its processes; `said` is given the rate of the map's instants.

    Raises:
        RuntimeError: If a process ended.
    """
    looks: dict[str, list[Look]] = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        small_ring(Path(folder)) as ring,
        Ear(ring.endpoint) as ear,
    ):
        ear.wait(lambda: next((i for i in ear.heard() if i.whole), None), START_S, "a whole map")
        time.sleep(warm_up_s)
        processes = ring.processes()
        began_s, before = time.monotonic(), ear.counts["mapper"]
        due_s = began_s
        while (due_s := due_s + PERIOD_S) <= began_s + seconds:
            time.sleep(max(0.0, due_s - time.monotonic()))
            for name, process in processes.items():
                try:
                    looks.setdefault(name, []).append(look(process))
                except (psutil.Error, OSError) as error:
                    raise RuntimeError(f"{name} ended: {error}\n{ring.said()}") from error
        span_s = time.monotonic() - began_s
        said["instants_hz"] = (ear.counts["mapper"] - before) / span_s
    quarter = max(1, len(looks["mapper"]) // 4)
    return [
        Growth(name, median_of(some[:quarter]), median_of(some[-quarter:]))
        for name, some in looks.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--warm-up", type=float, default=30.0)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    asked = parser.parse_args()
    print(describe("eclipse-zenoh", "numpy", "psutil"))
    said: dict[str, float] = {}
    grown = soak(asked.seconds, asked.warm_up, said)
    print(f"{asked.seconds:.0f} s, {said['instants_hz']:.1f} of {RATE_HZ:g} instants per second")
    print(f"{'':12}{'MB':>8}{'':>8}{'files':>7}{'sockets':>9}{'threads':>9}")
    for each in grown:
        first, last = each.first, each.last
        share = last.memory / first.memory - 1.0
        counts = f"{last.files:7}{last.sockets:9}{last.threads:9}"
        grew = "  GREW: " + ", ".join(each.faults) if each.faults else ""
        print(f"{each.name:12}{last.memory / 1e6:8.1f}{share:+8.1%}{counts}{grew}")
    if asked.json:
        rows = [asdict(each) | {"faults": each.faults} for each in grown]
        asked.json.write_text(json.dumps(said | {"processes": rows}, indent=1) + "\n")
    sys.exit(1 if any(each.faults for each in grown) or said["instants_hz"] < 0.1 else 0)


if __name__ == "__main__":
    main()
