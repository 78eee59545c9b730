"""All references of a tick: what a strategy and a change of formation cost.

Each figure is the median of many calls of the director, target given to views given, in the world
and with twists: at rest in a formation, and on the way from the ring to it. Pure computing: the
messages come on top, and are in `benchmarks/pipeline.py`.

    python benchmarks/planning.py [--cameras 64]
"""

import argparse
import time

import numpy as np
from machine import describe

from services.kernels.rigid import planar
from services.planner.director import Director
from services.planner.formation import FormationSettings, StrategyName
from services.planner.motion import Motion
from services.planner.warm_up import warm_up

STRATEGIES = ("circle", "rings", "sphere", "orbit", "random", "static", "dome")
AHEAD: tuple[StrategyName, ...] = ("adaptive_scale", "constant_angles", "adaptive_angles")
"""They look ahead, and are fixed on wheels; how wide they may be is in each of them."""
DT_S = 1 / 15
CALLS, CHANGES = 400, 9
AIM_MS = 1.0


def target_at(t_s: float) -> Motion:
    """Return a unicycle on a circle of 0.5 m, 0.1 m/s."""
    phase = 0.2 * t_s
    T = planar(0.5 * np.cos(phase), 0.5 * np.sin(phase), phase + np.pi / 2)
    return Motion(T, T[:3, :3] @ [0.1, 0, 0], np.array([0, 0, 0.2]))


def looking_ahead(strategy: StrategyName, cameras: int, radius_m: float) -> tuple[float, float]:
    """Return the median and the 99th percentile of one tick's time, of this process alone."""
    formation = FormationSettings(
        cameras=cameras, strategy=strategy, drive="unicycle", radius_m=radius_m
    )
    director, taken_ns = Director(formation), []
    for call in range(2 * CALLS):
        target = target_at(call * DT_S)
        began_ns = time.process_time_ns()
        director.plan(target, call * DT_S)
        taken_ns.append(time.process_time_ns() - began_ns)
    later = np.array(taken_ns[CALLS:]) * 1e-6
    return float(np.median(later)), float(np.percentile(later, 99))


def median_ms(director: Director, start_s: float, dt_s: float) -> float:
    """Return the median time of one tick's references."""
    taken_ns = []
    for call in range(CALLS):
        t_s = start_s + call * dt_s
        target = target_at(t_s)
        began_ns = time.perf_counter_ns()
        director.plan(target, t_s)
        taken_ns.append(time.perf_counter_ns() - began_ns)
    return float(np.median(taken_ns)) * 1e-6


def changing(formation: FormationSettings) -> Director:
    """Return a director that leads from a ring to a formation from the next tick on."""
    director = Director(FormationSettings(cameras=formation.cameras, radius_m=2.0))
    director.plan(target_at(0.0), 0.0)
    director.change(formation)
    return director


def with_gap(formation: FormationSettings) -> Director:
    """Return a director that has lost a camera of a formation, and closes the gap next."""
    director = Director(formation)
    director.plan(target_at(0.0), 0.0)
    director.vanish(2)
    return director


def first_tick_ms(directors: list[Director]) -> float:
    """Return the median time of the tick in which a change is planned, once."""
    taken_ns = []
    for director in directors:
        began_ns = time.perf_counter_ns()
        director.plan(target_at(DT_S), DT_S)
        taken_ns.append(time.perf_counter_ns() - began_ns)
    return float(np.median(taken_ns)) * 1e-6


def main() -> None:
    warm_up()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=64)
    cameras = parser.parse_args().cameras
    print(describe("encircle", "numpy"))
    print(f"{cameras} references, median of {CALLS}; aim: {AIM_MS:g} ms")
    for strategy in STRATEGIES:
        formation = FormationSettings(cameras=cameras, strategy=strategy)
        steady = Director(formation)
        median_ms(steady, 0.0, DT_S)  # Warm caches.
        at_rest_ms = median_ms(steady, CALLS * DT_S, DT_S)
        changes = [changing(formation) for _ in range(CHANGES)]
        gaps = [with_gap(formation) for _ in range(CHANGES)]
        first_ms, gap_ms = first_tick_ms(changes), first_tick_ms(gaps)
        on_the_way_ms = median_ms(changes[0], DT_S, 1e-5)
        print(
            f"  {strategy:7} {at_rest_ms:5.2f} ms, in a change {on_the_way_ms:5.2f} ms, "
            f"its first tick {first_ms:4.0f} ms, that of a loss {gap_ms:4.0f} ms"
        )
    for strategy in AHEAD:
        for what, radius_m in (("in view", 0.3), ("out of view", 1.1)):
            median, most = looking_ahead(strategy, cameras, radius_m)
            print(f"  {strategy:15} {what:11} {median:5.2f} ms CPU, 99 % within {most:5.2f} ms")


if __name__ == "__main__":
    main()
