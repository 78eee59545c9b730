"""Fusing depth images: ours beside every mapper that pip and apt have, on the same clouds.

Each mapper runs alone in a process of its own, one thread, on images and clouds written once. Times
are CPU time per image, the median over the images of a round. "Second round": every image has been
fused once before, by all alike; the claim is of this round. "Saturated": the eighth round, when
most voxels have reached a clamp. Agreement is that of the maps after the second round with
OctoMap's; over-carved is free here and unknown to OctoMap, over OctoMap's free. Memory is the
growth of the process by the map; "says" what the mapper itself states.

    python benchmarks/mapping.py            # about three minutes on a quiet machine
    python benchmarks/mapping.py --all      # the whole matrix, about an hour
    python benchmarks/mapping.py --scene room --size 320x240 --voxel 0.01 --peers pyoctomap
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
from machine import describe

from benchmarks.mapping_figures import Agreement
from benchmarks.mapping_ours import instant, region_of_interest, two_cores
from benchmarks.mapping_race import ALL, Measured, Race
from benchmarks.mapping_rivals import ABSENT
from benchmarks.mapping_scenes import SCENES, Scene, floor
from services.mapper.warm_up import warm_up

PROJECTIVE = "projective"
OURS = (PROJECTIVE, "exact, discretised", "exact, ray per point")
DISCRETISED, PER_POINT = "pyoctomap, discretised", "pyoctomap, ray per point"
JUDGES = {
    DISCRETISED: ("OctoMap C++, discretised", "exact, discretised"),
    PER_POINT: ("OctoMap C++, ray per point", "exact, ray per point"),
}
"""Whose classes stand for a peer's (the same library, which can be read in a second), and which of
our exact maps is to equal it."""
TIMED_ROUND, LATE_ROUND = 2, 8
MIB = 2**20


def report(scene: Scene, voxel_m: float, peers: list[str], late: bool, folder: Path) -> None:
    """Measure one scene and print it: ratios, then milliseconds and memory, then agreement."""
    race, found = Race(scene, voxel_m, folder), {}
    for name in (*OURS, *peers):
        # Only the projective map saturates to advantage; the slow ones run on only when asked.
        rounds = LATE_ROUND if late or name == PROJECTIVE else TIMED_ROUND
        measured = race.run(name, rounds)
        if isinstance(measured, str):
            print(f"  {name}: absent, {measured}")
        else:
            found[name] = measured
    # The same once more at the end, for two rounds: its classes are those of the timed round.
    again = race.run(PROJECTIVE, TIMED_ROUND)
    for name in found:
        if name not in OURS:
            ratios(found, name)
    print("  ms an image: first round, second, eighth; memory MiB: says, grew by, at most")
    for name, its in [*found.items(), (f"{PROJECTIVE}, after all others", again)]:
        if isinstance(its, str):
            continue
        columns = " ".join(f"{its.round_ms(n):8.2f}" for n in (1, TIMED_ROUND, LATE_ROUND))
        sizes = (its.nodes_bytes, its.steady_bytes, its.peak_bytes)
        print(f"    {name:30s} {columns}   ", " ".join(f"{size / MIB:7.1f}" for size in sizes))
    for theirs, (judge, exact) in JUDGES.items():
        if theirs in found:
            judged = early(race, found, judge)
            print(f"  {PROJECTIVE} | {theirs}: {agreement(again, judged)}")
            print(f"  {exact} | {theirs}: {agreement(early(race, found, exact), judged)}")


def early(race: Race, found: dict[str, Measured], name: str) -> Measured | str:
    """Return a mapper whose classes are those after the timed round."""
    its = found.get(name)
    if its is None or len(its.ms) != TIMED_ROUND:
        return race.run(name, TIMED_ROUND)
    return its


def agreement(ours: Measured | str, theirs: Measured | str) -> str:
    """Return the figures, or why there are none."""
    for its in (ours, theirs):
        if isinstance(its, str):
            return its
        if its.classes is None:
            return "no classes"
    assert isinstance(ours, Measured)
    assert isinstance(theirs, Measured)
    return str(Agreement.of(ours.classes, theirs.classes))


def ratios(found: dict[str, Measured], name: str) -> None:
    """Print how much more time and memory a peer takes than ours."""
    theirs, parts = found[name], []
    for ours in (PROJECTIVE, OURS[1] if "discretised" in name else OURS[2]):
        if ours != PROJECTIVE and "VoxelBlockGrid" in name:
            continue
        mine = found[ours]
        second = theirs.round_ms(TIMED_ROUND) / mine.round_ms(TIMED_ROUND)
        late = theirs.round_ms(LATE_ROUND) / mine.round_ms(LATE_ROUND)
        parts.append(f"{second:.1f} x {ours}" + (f" ({late:.1f} x saturated)" if late > 0 else ""))
    projective = found[PROJECTIVE]
    grown = theirs.steady_bytes / max(projective.steady_bytes, 1)
    peak = theirs.peak_bytes / max(projective.peak_bytes, 1)
    print(f"  {name}: " + ", ".join(parts) + f"; memory {grown:.1f} x, at most {peak:.1f} x")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", choices=[*SCENES], help="only this scene")
    parser.add_argument("--size", default="640x480", help="WIDTHxHEIGHT")
    parser.add_argument("--voxel", type=float, default=0.01, help="m")
    parser.add_argument("--images", type=int, default=6, help="at most so many of the six")
    parser.add_argument("--peers", help="only peers whose name begins so")
    parser.add_argument(
        "--late", action="store_true", help="eight rounds for all, not for ours alone"
    )
    parser.add_argument("--all", action="store_true", help="every scene, size and voxel size")
    arguments = parser.parse_args()
    print(describe("numba", "numpy", "pyoctomap", "open3d"))
    warm_up()
    peers = [n for n in ALL if n not in OURS and n.startswith(arguments.peers or "")]
    wanted, voxel_m = arguments.size, arguments.voxel
    if arguments.all:
        runs = [
            (scene, size, edge, 6, peers)
            for scene in SCENES
            for size in ("640x480", "320x240")
            for edge in (0.01, 0.005)
        ]
    elif arguments.scene:
        runs = [(arguments.scene, wanted, voxel_m, arguments.images, peers)]
    else:
        few = [n for n in peers if n in (DISCRETISED, JUDGES[DISCRETISED][0])]
        runs = [("bunny", wanted, voxel_m, 6, peers), ("room", wanted, voxel_m, 2, few)]
        runs += [("bunny", wanted, 0.005, 2, few)]
    with tempfile.TemporaryDirectory() as cache:
        for n, (name, size, edge_m, images, rivals) in enumerate(runs):
            folder = Path(cache) / str(n)
            folder.mkdir()
            scene = SCENES[name](parsed(size))
            scene = Scene(scene.views[:images], scene.box)
            returns = sum(len(cloud) for cloud, _ in scene.clouds()) / len(scene.views)
            print(
                f"\n{name}, {size}, {edge_m * 1e3:g} mm voxels, {len(scene.views)} images, ", end=""
            )
            print(f"{returns:.0f} returns each", flush=True)
            report(scene, edge_m, rivals, arguments.late or arguments.all, folder)
    print()
    print(instant(parsed(wanted), voxel_m))
    for name, its in (*SCENES.items(), ("floor", floor)):
        scene = its(parsed(wanted))
        ratio = region_of_interest(scene, voxel_m)
        across = scene.box[1][0] - scene.box[0][0]
        print(f"{name}: six cameras in a 1.2 m box, over all they see ({across:.3g} m): {ratio}")
    print(two_cores(SCENES["bunny"](parsed(wanted)), voxel_m))
    for name, reason in ABSENT.items():
        print(f"absent: {name}: {reason}")


def parsed(size: str) -> tuple[int, int]:
    """Return (width, height)."""
    width, _, height = size.partition("x")
    return int(width), int(height)


if __name__ == "__main__":
    main()
