"""What it costs to ask a map: rays and classes against OctoMap, distances, and colors.

Both maps are made of the same points: six 320 x 240 views of the cluttered room. Rays start
anywhere in its box and go anywhere, up to 3 m; all end voxels are compared. CPU time, median of
five; the peer, one run, called from Python ray by ray as its interface is, less the bare loop.

    python benchmarks/asking.py [--voxel 0.01] [--rays 20000]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from machine import describe
from pyoctomap import OcTree

from benchmarks.mapping_scenes import Scene, room
from services.mapper.voxel_map import VoxelMap

RANGE_M = 3.0
OCCUPIED = 2
ROUNDS = 5


def seconds(work: Callable[[], object]) -> float:
    """Return the median CPU time of a call."""
    work()
    spent = []
    for _ in range(ROUNDS):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return float(np.median(spent))


def built(scene: Scene, voxel_m: float) -> tuple[VoxelMap, OcTree]:
    """Return our map and OctoMap's of the same points."""
    ours, tree = VoxelMap(voxel_m, *scene.box), OcTree(voxel_m)
    for points, eye in scene.clouds():
        cloud, origin = (np.float32(part).astype(np.float64) for part in (points, eye))
        ours.fuse_points(cloud, origin)
        tree.insertPointCloud(np.ascontiguousarray(cloud), origin, -1.0, True, True)
    return ours, tree


def rays(ours: VoxelMap, tree: OcTree, box: tuple, count: int, unknown_stops: bool) -> str:
    """Cast rays in both maps; return the row."""
    rng = np.random.default_rng(0)
    drawn = rng.uniform(*box, (count, 3)), rng.normal(size=(count, 3))
    origins, ways = (np.float32(part).astype(np.float64) for part in drawn)
    hits = ours.cast_rays(origins, ways, RANGE_M, unknown_stops)
    ours_s = seconds(lambda: ours.cast_rays(origins, ways, RANGE_M, unknown_stops))
    end, ends, hit = np.zeros(3), np.zeros((count, 3)), np.zeros(count, bool)
    start = time.process_time()
    for n in range(count):
        hit[n] = tree.castRay(origins[n], ways[n], end, not unknown_stops, RANGE_M)
        ends[n] = end
    peer_s = time.process_time() - start
    start = time.process_time()
    for n in range(count):
        hit[n], ends[n] = hit[n], ends[n]
    peer_s -= time.process_time() - start
    same = (hits.outcome == OCCUPIED) == hit
    same[hit] &= np.isclose(hits.points_m[hit], ends[hit], atol=1e-4).all(axis=1)
    name = "stopped by unknown space" if unknown_stops else "through unknown space"
    return (
        f"rays {name:<25}{ours_s / count * 1e6:7.2f} us each, pyoctomap {peer_s / count * 1e6:6.1f}"
        f" us: {peer_s / ours_s:5.1f} x; {hit.mean():.0%} hit, {(~same).sum()} of {count} differ"
    )


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--voxel", type=float, default=0.01)
    parser.add_argument("--rays", type=int, default=20_000)
    args = parser.parse_args()
    print(describe("numpy", "numba", "pyoctomap", "scipy"))
    scene = room((320, 240))
    ours, tree = built(scene, args.voxel)
    print(f"{args.voxel * 100:g} cm, box {ours.box.shape}, {ours.counts().occupied} occupied")
    for unknown_stops in (False, True):
        print(rays(ours, tree, scene.box, args.rays, unknown_stops))
    points = np.random.default_rng(1).uniform(*scene.box, (args.rays, 3))
    each = 1e6 / args.rays
    print(f"classes   {seconds(lambda: ours.classify(points)) * each:7.3f} us each")
    print(
        f"distances {seconds(lambda: ours.distance(points, 0.5)) * each:7.2f} us each, up to 0.5 m"
    )
    part = ((-0.3, -0.3, 0.0), (0.3, 0.3, 0.4))
    shape = ours.distance_field(part, 0.3)[0].shape
    field_s = seconds(lambda: ours.distance_field(part, 0.3))
    print(f"distance field of {shape}, 0.3 m around looked at: {field_s * 1e3:.0f} ms")
    plain, colored = (VoxelMap(args.voxel, *scene.box) for _ in range(2))
    picture = np.zeros((*scene.views[0].depth.shape, 3), np.uint8)
    view = scene.views[0]
    shot = view.depth, view.pinhole, view.T_map_camera, view.scale_m, view.max_range_m
    plain_s = seconds(lambda: plain.fuse_depth(*shot))
    colored_s = seconds(lambda: colored.fuse_depth(*shot, picture))
    print(f"a depth image: {plain_s * 1e3:.1f} ms, with its picture {colored_s * 1e3:.1f} ms")


if __name__ == "__main__":
    main()
