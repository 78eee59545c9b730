"""A drive through a rolling window: as a map that never moves, in memory that does not grow."""

import resource
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.road import HEIGHT, RANGE_M, WIDTH, Road, camera_at
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

LOW_M, HIGH_M = np.array((-9.0, -9.0, -1.0)), np.array((9.0, 9.0, 4.0))
LENGTH_M = 16.0
# Halves all the way down: projections round alike wherever the box is, so equal means equal.
RESOLUTION_M, STEP_M, SCALE_M = 1 / 8, 1 / 4, 1 / 1024
PINHOLE = (64.0, 64.0, WIDTH / 2, HEIGHT / 2)


@pytest.fixture(scope="module")
def road() -> Road:
    return Road(LENGTH_M, seed=3)


def frames(road: Road) -> list[tuple[np.ndarray, np.ndarray]]:
    out = []
    for x_m in np.arange(0.0, LENGTH_M, STEP_M):
        T = np.round(camera_at(0.0))
        T[:3, 3] = x_m, 0.0, 1.5
        out.append((road.depth(T), T))
    return out


def fuse(voxel_map: VoxelMap, depth: np.ndarray, T: np.ndarray) -> None:
    voxel_map.fuse_depth(depth, PINHOLE, T, SCALE_M, RANGE_M)


def never_moving() -> VoxelMap:
    return VoxelMap(RESOLUTION_M, LOW_M, HIGH_M + np.array((LENGTH_M, 0, 0)))


def window_of(still: VoxelMap, rolling: VoxelMap) -> np.ndarray:
    """Cut the rolling map's window out of a map it lies in."""
    first = np.subtract(rolling.box.first_key, still.box.first_key)
    cut = tuple(slice(a, a + n) for a, n in zip(first, rolling.box.shape, strict=True))
    return still.log_odds_dense()[cut]


@pytest.mark.parametrize("archive", [False, True])
def test_on_the_way_the_window_is_as_one_that_never_moved_and_with_an_archive_so_is_the_way_back(
    road: Road, archive: bool
) -> None:
    rolling, still = VoxelMap(RESOLUTION_M, LOW_M, HIGH_M, archive=archive), never_moving()
    moves = 0
    for n, (depth, T) in enumerate(frames(road)):
        moves += rolling.move_to((T[0, 3], 0.0, 1.5))
        fuse(rolling, depth, T)
        fuse(still, depth, T)
        if n % 8 == 7:
            np.testing.assert_array_equal(rolling.log_odds_dense(), window_of(still, rolling))
    assert moves > 10
    rolling.move_to((0.0, 0.0, 1.5), 0.0)
    back = rolling.log_odds_dense()
    known = np.isfinite(window_of(still, rolling))
    assert known.sum() > 50_000
    if archive:
        np.testing.assert_array_equal(back, window_of(still, rolling))
    else:
        assert np.isnan(back[:40]).all()


def test_an_archive_holds_what_is_known_and_no_more(road: Road) -> None:
    rolling, still = VoxelMap(RESOLUTION_M, LOW_M, HIGH_M, archive=True), never_moving()
    for depth, T in frames(road):
        rolling.move_to((T[0, 3], 0.0, 1.5))
        fuse(rolling, depth, T)
        fuse(still, depth, T)
    assert rolling.num_archived + len(rolling.known_bricks()[0]) == len(still.known_bricks()[0])
    empty = rolling.num_bytes
    rolling.move_to((5000.0, 0.0, 1.5))
    kept, bricks = rolling.num_bytes - empty, len(still.known_bricks()[0])
    assert rolling.num_archived == bricks
    assert kept < 60 * bricks
    rolling.clear()
    assert rolling.num_archived == 0


@pytest.mark.slow
@pytest.mark.parametrize("archive", [False, True])
def test_over_a_kilometre_neither_memory_nor_time_per_frame_grows(archive: bool) -> None:
    road, rolling = Road(1000.0), VoxelMap(0.1, LOW_M, HIGH_M, archive=archive)
    ms: list[float] = []
    held, rss, num_open = [], [], []
    for n in range(2001):
        T = camera_at(0.5 * n, 0.4 * np.sin(n / 16), 0.2)
        depth = road.depth(T)
        began = time.process_time()
        rolling.move_to((T[0, 3], 0.0, 1.5))
        rolling.fuse_depth(depth, PINHOLE, T, 0.001, RANGE_M)
        rolling.changes()
        ms.append((time.process_time() - began) * 1e3)
        held.append(rolling.num_bytes)
        num_open.append(rolling.num_open)
        if n % 500 == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            rss.append(pages * resource.getpagesize())
    assert np.median(ms[1500:]) < 1.5 * np.median(ms[100:600])
    assert max(num_open[200:]) < 1.3 * np.median(num_open[200:])
    if archive:
        assert rolling.num_archived > 20_000
    else:
        assert max(held[500:]) < 1.01 * max(held[:500])
        assert rss[4] < rss[1] + (4 << 20)
