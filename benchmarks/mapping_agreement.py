"""How sampled free space agrees with OctoMap's, on scenes that are hard on it: a table.

Each scene is six views, 1 cm. OctoMap is asked twice: a ray per point, which is its default and
what the contract is kept against, and discretised, one ray per end voxel. "OctoMap" is the one
against the other: where that row misses the contract with discretised, no ray per pixel keeps it.
Over-carved is free here and unknown to OctoMap, over OctoMap's free.

    python benchmarks/mapping_agreement.py [--size 640x480] [--voxel 0.01] [--scene room]
"""

import argparse
import itertools
import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
import numpy as np
from machine import describe
from numpy.typing import NDArray

from benchmarks.mapping_figures import LEAST, MOST_OVER, Agreement
from benchmarks.mapping_race import Race
from benchmarks.mapping_trials import TRIALS

SIZES = ("640x480", "320x240")
PER_POINT, DISCRETISED = "OctoMap C++, ray per point", "OctoMap C++, discretised"


def row(figures: Agreement) -> str:
    """Return four figures and whether they keep the contract."""
    mark = " " if figures.holds else "*"
    shares = f"{figures.same:.5f}   {figures.occupied:.4f}  {figures.free:.4f}"
    return f"{shares}  {figures.over:7.3%} {mark}"


def classes(race: Race, name: str) -> NDArray[np.uint8]:
    """Return what a mapper knows after one round."""
    measured = race.run(name, 1)
    if isinstance(measured, str) or measured.classes is None:
        raise SystemExit(f"{name}: {measured}")
    return measured.classes


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", choices=SIZES, help="only this size")
    parser.add_argument("--voxel", type=float, default=0.01, help="m")
    parser.add_argument("--scene", choices=[*TRIALS], help="only this scene")
    arguments = parser.parse_args()
    print(describe("numba", "numpy"))
    least = ", ".join(f"{name} {value}" for name, value in LEAST.items())
    print(f"contract: {least}, over-carved {MOST_OVER:.1%}; * misses it")
    head = "same      occ     free    over     "
    print(f"{'':43s}ray per point: {head} discretised: {head}")
    sizes = [arguments.size] if arguments.size else SIZES
    names = [arguments.scene] if arguments.scene else [*TRIALS]
    with tempfile.TemporaryDirectory() as folder:
        for size, name in itertools.product(sizes, names):
            width, height = (int(side) for side in size.split("x"))
            place = Path(folder) / f"{size} {name}"
            place.mkdir()
            compare(
                f"{size}  {name:22s}", Race(TRIALS[name]((width, height)), arguments.voxel, place)
            )


def compare(label: str, race: Race) -> None:
    """Print the rows of one scene."""
    per_point, discretised = classes(race, PER_POINT), classes(race, DISCRETISED)
    ours = classes(race, "projective")
    beside = row(Agreement.of(ours, discretised))
    print(f"{label}  ours     {row(Agreement.of(ours, per_point))}    {beside}")
    print(f"{label}  OctoMap  {'':41s}    {row(Agreement.of(per_point, discretised))}", flush=True)


if __name__ == "__main__":
    main()
