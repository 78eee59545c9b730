"""Fusing depth images: both integrators beside pyoctomap, on the same clouds, in the same run.

Six cameras on a ring around spheres and boxes on a plate. CPU time of the process, one thread,
warm (every image has been fused once before), median over the images. Agreement is that of the maps
after all rounds, voxel by voxel. Over-carved: free here, unknown to OctoMap, over OctoMap's free.

    python benchmarks/mapping.py [--size 640x480] [--voxel 0.01] [--rounds 2] [--rays]
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from mapping_scene import FloatArray, camera_pose, depth_image, points
from numpy.typing import NDArray
from pyoctomap import OcTree

from services.mapper.projective import View
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up

sys.path.append(str(Path(__file__).parents[1]))
from tests.octomap_reference import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    classes_in,
    classes_of,
    iou,
    log_odds_in,
)

NUM_CAMERAS = 6
VFOV_RAD = math.radians(45)
MAX_RANGE_M = 10.0
ROOM = ((-1.28, -1.28, -0.16), (1.28, 1.28, 1.12))
"""Holds all that the cameras see: OctoMap's whole map and ours are the same region."""
JOB = ((-0.6, -0.6, -0.1), (0.6, 0.6, 0.7))
"""The box of the main job."""
FAST_ROUNDS = 20


def cpu_ms(work: Callable[[], object]) -> float:
    """Return the CPU time of one call."""
    began = time.process_time()
    work()
    return (time.process_time() - began) * 1e3


def views_of(width: int, height: int, empty: int) -> list[View]:
    """Return one image per camera."""
    rng = np.random.default_rng(0)
    focal_px = height / 2 / math.tan(VFOV_RAD / 2)
    pinhole = (focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)
    views = []
    for k in range(NUM_CAMERAS):
        T = camera_pose(0.13 + k * 2 * math.pi / NUM_CAMERAS, 1.03, 0.58, 0.2)
        image = depth_image((height, width), pinhole, T, rng, empty)
        views.append(View(image, pinhole, T, 0.001, MAX_RANGE_M))
    return views


def octomap(
    voxel_m: float, clouds: list[tuple[FloatArray, FloatArray]], rounds: int, *, discretize: bool
) -> tuple[float, OcTree]:
    """Return the median of the last rounds, ms, and the map."""
    tree, times = OcTree(voxel_m), []
    for _ in range(rounds):
        for cloud, eye in clouds:
            insert = (cloud, eye, -1.0, False, discretize)
            times.append(cpu_ms(lambda i=insert: tree.insertPointCloud(*i)))
    return float(np.median(times[len(clouds) :])), tree


def ours(
    voxel_map: VoxelMap, inputs: list[Any], rounds: int, fuse: Callable[[VoxelMap, Any], object]
) -> tuple[float, NDArray[np.uint8]]:
    """Return the median of the warm rounds, ms, and the classes after `rounds`."""
    times, classes = [], classes_in(voxel_map)
    for n in range(max(rounds, FAST_ROUNDS)):
        if n == rounds:
            classes = classes_in(voxel_map)
        times += [cpu_ms(lambda i=i: fuse(voxel_map, i)) for i in inputs]
    return float(np.median(times[len(inputs) :])), classes


def fuse_view(voxel_map: VoxelMap, view: View) -> object:
    """Fuse by projection."""
    return voxel_map.fuse_depth(
        view.depth, view.pinhole, view.T_map_camera, view.scale_m, view.max_range_m
    )


def agreement(mine: NDArray[np.uint8], theirs: NDArray[np.uint8]) -> str:
    """Return the figures of two maps."""
    both = (mine != UNKNOWN) & (theirs != UNKNOWN)
    over = ((mine == FREE) & (theirs == UNKNOWN)).sum() / (theirs == FREE).sum()
    return (
        f"same class where both know {(mine == theirs)[both].mean():.5f}, "
        f"IoU occupied {iou(mine, theirs, OCCUPIED):.4f} free {iou(mine, theirs, FREE):.4f}, "
        f"over-carved {over:.2%}"
    )


def instant(voxel_m: float, views: list[View]) -> None:
    """Print what an instant of the main job costs: clear, fuse, changes, counts."""
    box = VoxelMap(voxel_m, *JOB)
    stages: dict[str, list[float]] = {"fuse": [], "changes": [], "counts": [], "entropy": []}
    for n in range(FAST_ROUNDS):
        # Alternate views, so that there are changes to tell.
        shown = views if n % 2 else views[1:]

        def fuse(shown: list[View] = shown) -> None:
            box.clear()
            box.fuse_many(shown)

        stages["fuse"].append(cpu_ms(fuse) / len(shown))
        stages["changes"].append(cpu_ms(box.changes))
        stages["counts"].append(cpu_ms(box.counts))
        stages["entropy"].append(cpu_ms(box.entropy_bits))
    fuse_ms, changes_ms, counts_ms, entropy_ms = (np.median(stages[k][2:]) for k in stages)
    print(
        f"main job's box {box.box.shape}, memory instant: {fuse_ms:.2f} ms a camera; per instant "
        f"changes {changes_ms:.2f}, counts {counts_ms:.2f}, entropy {entropy_ms:.2f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--voxel", type=float, default=0.01)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--rays", action="store_true", help="also OctoMap without discretising")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    voxel_m, rounds = arguments.voxel, max(arguments.rounds, 2)
    print(describe("pyoctomap", "numba", "numpy"))
    warm_up()
    views = views_of(width, height, empty=0)  # OctoMap cannot be told of a pixel without return.
    clouds = [(points(v.depth, v.pinhole, v.T_map_camera), v.T_map_camera[:3, 3]) for v in views]
    num_points = np.mean([len(cloud) for cloud, _ in clouds])
    print(f"{width}x{height}, {voxel_m * 1e3:g} mm voxels, {num_points:.0f} returns an image")
    projective = VoxelMap(voxel_m, *ROOM)
    projective_ms, projected = ours(projective, views, rounds, fuse_view)
    for discretize in (True, False) if arguments.rays else (True,):
        octomap_ms, tree = octomap(voxel_m, clouds, rounds, discretize=discretize)
        theirs = classes_of(log_odds_in(tree, projective.box))
        exact_ms, cast = ours(
            VoxelMap(voxel_m, *ROOM),
            clouds,
            rounds,
            lambda m, c, d=discretize: m.fuse_points(*c, discretize=d),
        )
        print(
            f"pyoctomap, {'discretised' if discretize else 'a ray per point'}: {octomap_ms:.0f} ms"
        )
        print(f"  exact      {exact_ms:7.2f} ms, {octomap_ms / exact_ms:4.0f}x; ", end="")
        print(agreement(cast, theirs))
        print(f"  projective {projective_ms:7.2f} ms, {octomap_ms / projective_ms:4.0f}x; ", end="")
        print(agreement(projected, theirs))
        print(f"  memory: OctoMap {tree.memoryUsage() / 2**20:.0f} MiB of nodes, ", end="")
        print(f"bricks {projective.num_bytes / 2**20:.0f} MiB")
    instant(voxel_m, views_of(width, height, empty=65535))


if __name__ == "__main__":
    main()
