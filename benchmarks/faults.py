"""Kill and freeze the processes of a running ring: how soon is it noticed, how soon is all well?

A ring of three cameras runs in real time. In each round every victim is killed (SIGKILL; the
supervisor starts it again) and frozen (SIGSTOP for 5 s, longer than the bus waits, then SIGCONT).
All is well with the first instant, begun after the fault, or its end, that all cameras are in,
whose F-score is at least 0.9 of the undisturbed median, and which the victim, started again, has
taken part in. For the router it is well when a new session, opened after the fault, hears such an
instant. Between two deaths of one victim lie 31 s, so that the supervisor does not count them as a
row of crashes and wait longer each time. A start's processor time is told beside: on a machine
that is busy with other things it takes a multiple of that.

    python benchmarks/faults.py [--times 100] [--victims camera mapper planner router] [--json FILE]
"""

import argparse
import itertools
import json
import statistics
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from machine import describe
from small_ring import CAMERAS, START_S, Ear, Ring, small_ring

VICTIMS = ("camera", "mapper", "planner", "router")
FREEZE_S = 5.0
APART_S = 31.0
QUALITY_SHARE = 0.9
PATIENCE_S = 90.0
BASELINE = 40
Fault = Literal["killed", "frozen"]
FAULTS: tuple[Fault, ...] = ("frozen", "killed")


@dataclass(frozen=True)
class Trial:
    """One fault; seconds."""

    victim: str
    fault: Fault
    noticed_s: float | None
    """From the fault to the first word that somebody is missing; None: nobody had to notice."""
    recovered_s: float
    """From the fault, or from the thaw, to the first good instant."""
    longest_gap_s: float
    """Between two instants of the map, whole or not, from the fault to the recovery."""
    start_cpu_s: float | None
    """Processor time of the process that was started anew, until its first word."""


def strike(ring: Ring, ear: Ear, victim: str, fault: Fault, threshold: float) -> Trial:
    """Kill or freeze one process, and wait until all is well."""
    process = ring.processes()[victim]
    known = set(ear.boots.get(victim, ()))
    struck_s = from_s = time.monotonic()
    if fault == "killed":
        process.kill()
    else:
        process.suspend()
        time.sleep(FREEZE_S)
        from_s = time.monotonic()
        process.resume()
    tick = ear.tick

    def spoke_again_s() -> float | None:
        if fault == "frozen":
            return from_s if ear.spoke_s[victim] >= from_s else None
        return next((s for boot, s in ear.boots[victim].items() if boot not in known), None)

    start_cpu_s = None
    if victim == "router":
        with Ear(ring.endpoint) as newcomer:
            good_s = first_good_s(newcomer, from_s, tick, threshold)
    else:
        since_s = ear.wait(spoke_again_s, PATIENCE_S, f"{victim} {fault} speaks again")
        if fault == "killed":
            spent = ring.processes()[victim].cpu_times()
            start_cpu_s = spent.user + spent.system
        good_s = first_good_s(ear, since_s, tick, threshold)
    return Trial(
        victim.partition("/")[0],
        fault,
        noticed_s(ear, victim, struck_s),
        good_s - from_s,
        longest_gap_s(ear, struck_s, good_s),
        start_cpu_s,
    )


def first_good_s(ear: Ear, since_s: float, tick: int, threshold: float) -> float:
    """Wait for an instant that is whole and good; return when it was heard."""
    found = ear.wait(lambda: ear.first_good(since_s, tick, threshold), PATIENCE_S, "all is well")
    return found.heard_s


def noticed_s(ear: Ear, victim: str, struck_s: float) -> float | None:
    """Return how long after a fault somebody said that the victim is missing."""
    words = [s for name, s in ear.left_s.items() if name == victim and s > struck_s]
    if victim.startswith("camera/"):
        camera = int(victim.partition("/")[2])
        lacking = (i.heard_s for i in ear.heard() if i.heard_s > struck_s and camera not in i.used)
        words += [next(lacking, words[0] if words else struck_s + PATIENCE_S)]
    return min(words) - struck_s if words else None


def longest_gap_s(ear: Ear, since_s: float, until_s: float) -> float:
    """Return the longest time without any instant of the map."""
    heard = [i.heard_s for i in ear.heard() if since_s <= i.heard_s <= until_s]
    return float(np.diff([since_s, *heard, until_s]).max())


def undisturbed(ear: Ear) -> float:
    """Wait for the run to settle; return the F-score that counts as good."""

    def scores() -> list[float] | None:
        whole = [i.tick for i in ear.heard() if i.whole and i.tick in ear.f_scores]
        return [ear.f_scores[tick] for tick in whole] if len(whole) >= BASELINE else None

    return QUALITY_SHARE * statistics.median(ear.wait(scores, START_S, "the run has begun"))


def trials(victims: list[str], times: int) -> list[Trial]:
    """Run a ring and strike each victim, both ways, so many times."""
    done: list[Trial] = []
    died_s: dict[str, float] = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        small_ring(Path(folder)) as ring,
        Ear(ring.endpoint) as ear,
    ):
        threshold = undisturbed(ear)
        print(f"good: an F-score of {threshold:.3f} at twice the resolution", flush=True)
        for number, kind, fault in itertools.product(range(times), victims, FAULTS):
            victim = f"camera/{CAMERAS[number % len(CAMERAS)]}" if kind == "camera" else kind
            if fault == "killed":
                lived_s = time.monotonic() - died_s.get(victim, -APART_S)
                time.sleep(max(0.0, APART_S - lived_s))
            try:
                done.append(strike(ring, ear, victim, fault, threshold))
            except TimeoutError:
                print(ring.said(), flush=True)
                raise
            if fault == "killed":
                died_s[victim] = time.monotonic()
            print(done[-1], flush=True)
    return done


def figures(done: list[Trial]) -> list[str]:
    """Return the table, one row per victim and fault."""
    head = f"{'':18}{'noticed p50':>13}{'p95':>7}{'well again p50':>16}{'p95':>7}"
    rows = [f"{head}{'gap':>7}{'start-up':>10}  N"]
    for victim, fault in dict.fromkeys((trial.victim, trial.fault) for trial in done):
        some = [trial for trial in done if (trial.victim, trial.fault) == (victim, fault)]
        noticed = [trial.noticed_s for trial in some if trial.noticed_s is not None]
        told = "{:13.2f}{:7.2f}".format(*np.percentile(noticed, (50, 95))) if noticed else " " * 20
        well = "{:16.2f}{:7.2f}".format(*np.percentile([t.recovered_s for t in some], (50, 95)))
        gap = max(trial.longest_gap_s for trial in some)
        spent = [trial.start_cpu_s for trial in some if trial.start_cpu_s is not None]
        cpu = f"{np.median(spent):8.2f} s" if spent else " " * 10
        rows.append(f"{victim + ' ' + fault:18}{told}{well}{gap:7.2f}{cpu}  {len(some)}")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--victims", nargs="+", choices=VICTIMS, default=VICTIMS)
    parser.add_argument("--json", type=Path, help="also write every trial here")
    asked = parser.parse_args()
    print(describe("eclipse-zenoh", "numpy"))
    done = trials(list(asked.victims), asked.times)
    if asked.json:
        asked.json.write_text(json.dumps([asdict(trial) for trial in done], indent=1) + "\n")
    print("\n".join(figures(done)))
    print(describe("eclipse-zenoh", "numpy"))


if __name__ == "__main__":
    main()
