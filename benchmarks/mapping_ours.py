"""Rows that need no other mapper: the main job's instant, its region of interest, two cores."""

import time
from collections.abc import Callable

import numpy as np

from benchmarks.mapping_scene import NO_RETURN
from benchmarks.mapping_scenes import JOB, Box, Scene, toys
from services.mapper.voxel_map import VoxelMap

ROUNDS = 20


def cpu_ms(work: Callable[[], object]) -> float:
    """Return the CPU time of one call."""
    began = time.process_time()
    work()
    return (time.process_time() - began) * 1e3


def wall_ms(work: Callable[[], object]) -> float:
    """Return the wall-clock time of one call."""
    began = time.perf_counter()
    work()
    return (time.perf_counter() - began) * 1e3


def instant(size: tuple[int, int], voxel_m: float) -> str:
    """Return what an instant of the main job costs: clear, fuse, changes, counts."""
    views, box = toys(size, NO_RETURN).views, VoxelMap(voxel_m, *JOB)
    stages: dict[str, list[float]] = {"fuse": [], "changes": [], "counts": [], "entropy": []}
    for n in range(ROUNDS):
        # Alternate views, so that there are changes to tell.
        shown = views if n % 2 else views[1:]

        def fuse(shown: list = shown) -> None:
            box.clear()
            box.fuse_many(shown)

        stages["fuse"].append(cpu_ms(fuse) / len(shown))
        stages["changes"].append(cpu_ms(box.changes))
        stages["counts"].append(cpu_ms(box.counts))
        stages["entropy"].append(cpu_ms(box.entropy_bits))
    fuse_ms, changes_ms, counts_ms, entropy_ms = (np.median(stages[k][2:]) for k in stages)
    return (
        f"main job's box {box.box.shape}, memory instant: {fuse_ms:.2f} ms a camera; per instant "
        f"changes {changes_ms:.2f}, counts {counts_ms:.2f}, entropy {entropy_ms:.2f} ms"
    )


def region_of_interest(scene: Scene, voxel_m: float) -> str:
    """Return what a scene's cameras cost in a 1.2 m box, over what they cost in all they see."""

    def times(box: Box) -> list[float]:
        # The second look of an empty map, as in the rows above.
        voxel_map = VoxelMap(voxel_m, *box)
        return [cpu_ms(lambda: voxel_map.fuse_many(scene.views)) for _ in range(2)]

    rounds = [(times(JOB), times(scene.box)) for _ in range(ROUNDS // 2)]
    small, whole = np.median(rounds[1:], axis=0)
    return (
        f"{small[1] / whole[1]:.2f} ({small[1]:.1f} of {whole[1]:.1f} ms; "
        f"first round {small[0] / whole[0]:.2f})"
    )


def two_cores(scene: Scene, voxel_m: float) -> str:
    """Return how much sooner two threads end, wall clock."""
    clouds = scene.clouds()

    def depth(threads: int) -> float:
        voxel_map = VoxelMap(voxel_m, *scene.box)
        voxel_map.fuse_many(scene.views, threads=threads)
        return wall_ms(lambda: voxel_map.fuse_many(scene.views, threads=threads))

    def cast(threads: int) -> float:
        voxel_map = VoxelMap(voxel_m, *scene.box)
        voxel_map.fuse_points(*clouds[0], threads=threads)
        return wall_ms(lambda: [voxel_map.fuse_points(*c, threads=threads) for c in clouds[1:]])

    lines = []
    for name, work in (("fuse_many", depth), ("fuse_points", cast)):
        one, two = np.median([(work(1), work(2)) for _ in range(5)], axis=0)
        lines.append(f"{name} {one / two:.2f} x ({one:.1f} to {two:.1f} ms)")
    return "two cores, wall clock, second round: " + ", ".join(lines)
