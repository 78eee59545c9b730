"""A drive of a kilometre through a window: memory and time per frame stay what they are.

python benchmarks/rolling_window.py            # what leaves the window is forgotten
python benchmarks/rolling_window.py --archive  # it is kept, and there again on the way back
"""

import argparse
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from machine import describe

from benchmarks.road import PINHOLE, RANGE_M, SCALE_M, Road, camera_at
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up

STEP_M = 0.2
LOW_M, HIGH_M = np.array((-11.0, -11.0, -0.8)), np.array((11.0, 11.0, 4.8))
KNOWN_M = 60.0
"""The beginning of the road, which a map that never moves holds too."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--metres", type=float, default=1000.0)
    parser.add_argument("--voxel-m", type=float, default=0.05)
    parser.add_argument("--archive", action="store_true")
    args = parser.parse_args()
    warm_up()
    print(describe("encircle", "numpy", "numba"))
    rolling = VoxelMap(args.voxel_m, LOW_M, HIGH_M, archive=args.archive)
    bricks = int(np.prod(rolling.box.num_bricks))
    behind = "kept in the archive" if args.archive else "forgotten"
    print(
        f"\n{args.metres:g} m, a 160x120 image every {STEP_M} m, {args.voxel_m * 100:g} cm voxels; "
        f"window 22 x 22 x 5.6 m = {bricks} bricks; what leaves it is {behind}"
    )
    road = Road(args.metres)
    drive(rolling, road, args.metres)
    if args.archive:
        go_back(rolling, road, args.voxel_m)
    else:
        compare(road, args.voxel_m)


def drive(rolling: VoxelMap, road: Road, metres: float) -> None:
    """Drive, and print a line every quarter."""
    times: dict[str, list[float]] = {"move": [], "fuse": [], "changes": []}
    start_mb, quarters = rss_mb(), iter(np.linspace(0.0, metres, 5))
    next_m = next(quarters)
    for n in range(round(metres / STEP_M) + 1):
        fuse_timed(rolling, road.depth(pose_at(n)), pose_at(n), times)
        if n * STEP_M >= next_m - 1e-9:
            row(n * STEP_M, rolling, times, rss_mb() - start_mb)
            next_m = next(quarters, np.inf)
            times = {name: [] for name in times}


def fuse_timed(
    rolling: VoxelMap, depth: np.ndarray, T: np.ndarray, times: dict[str, list[float]]
) -> None:
    """Move, fuse, tell."""
    began = time.process_time()
    rolling.move_to(window_at(T))
    moved = time.process_time()
    rolling.fuse_depth(depth, PINHOLE, T, SCALE_M, RANGE_M)
    fused = time.process_time()
    rolling.changes()
    told = time.process_time()
    for name, ms in (("move", moved - began), ("fuse", fused - moved), ("changes", told - fused)):
        times[name].append(ms * 1e3)


def row(x_m: float, rolling: VoxelMap, times: dict[str, list[float]], grown_mb: float) -> None:
    """Print where the drive is and what it costs."""
    total = np.sum([times[name] for name in times], axis=0)
    median = {name: float(np.median(values)) for name, values in times.items()}
    moves = [ms for ms in times["move"] if ms > 0.2] or [0.0]
    print(
        f"  {x_m:5.0f} m  map {rolling.num_bytes / 1e6:5.1f} MB, RSS {grown_mb:+6.1f} MB  "
        f"{rolling.num_open:5d} bricks open, {rolling.num_archived:6d} archived  "
        f"frame {np.median(total):5.2f} ms, 99 % {np.quantile(total, 0.99):5.2f} "
        f"(fuse {median['fuse']:.2f}, changes {median['changes']:.2f}, "
        f"a move {np.median(moves):.2f})"
    )


def compare(road: Road, voxel_m: float) -> None:
    """Drive the beginning once more beside a map that never moves."""
    rolling, still = VoxelMap(voxel_m, LOW_M, HIGH_M), never_moving(voxel_m)
    compared, differ = 0, 0
    for n in range(round(KNOWN_M / STEP_M) + 1):
        T = pose_at(n)
        depth = road.depth(T)
        rolling.move_to(window_at(T))
        for voxel_map in (rolling, still):
            voxel_map.fuse_depth(depth, PINHOLE, T, SCALE_M, RANGE_M)
        if n % 20 == 0:
            mine, theirs = rolling.log_odds_dense(), part_of(still, rolling)
            differ += int((~same(mine, theirs)).sum())
            compared += int(np.isfinite(theirs).sum())
    print(f"  against a map that never moves: {differ} of {compared} known voxels differ")


def go_back(rolling: VoxelMap, road: Road, voxel_m: float) -> None:
    """Return to the beginning without fusing, and compare with a map that never moved."""
    still, held = never_moving(voxel_m), rolling.num_bytes
    for n in range(round(KNOWN_M / STEP_M) + 1):
        still.fuse_depth(road.depth(pose_at(n)), PINHOLE, pose_at(n), SCALE_M, RANGE_M)
    began = time.process_time()
    rolling.move_to((20.0, 0.0, 2.0))
    ms = (time.process_time() - began) * 1e3
    mine, theirs = rolling.log_odds_dense(), part_of(still, rolling)
    print(
        f"  back at 20 m in one move of {ms:.1f} ms: {int((~same(mine, theirs)).sum())} of "
        f"{int(np.isfinite(theirs).sum())} known voxels differ from a map that never forgot; "
        f"window and archive held {held / 1e6:.1f} MB"
    )


def pose_at(n: int) -> np.ndarray:
    return camera_at(n * STEP_M, yaw_rad=0.4 * np.sin(n / 40), pitch_rad=0.2)


def window_at(T: np.ndarray) -> np.ndarray:
    return np.array((T[0, 3], T[1, 3], 2.0))


def never_moving(voxel_m: float) -> VoxelMap:
    return VoxelMap(voxel_m, LOW_M - np.array((0, 4, 0)), HIGH_M + np.array((KNOWN_M, 4, 0)))


def part_of(still: VoxelMap, rolling: VoxelMap) -> np.ndarray:
    """Cut the rolling map's window out of a larger map; what is outside of that is unknown."""
    first = np.subtract(rolling.box.first_key, still.box.first_key)
    big, out = still.log_odds_dense(), np.full(rolling.box.shape, np.nan, np.float32)
    low = np.maximum(first, 0)
    high = np.minimum(first + rolling.box.shape, big.shape)
    there = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    here = tuple(slice(a, b) for a, b in zip(low - first, high - first, strict=True))
    out[here] = big[there]
    return out


def same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a == b) | (np.isnan(a) & np.isnan(b))


def rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


if __name__ == "__main__":
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    main()
