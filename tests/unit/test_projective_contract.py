"""How far sampled free space may differ from OctoMap's, on scenes that are hard on it.

`benchmarks/mapping_agreement.py` prints the figures.
"""

import functools
from pathlib import Path

import numpy as np
import pytest

from benchmarks.mapping_figures import Agreement
from benchmarks.mapping_scenes import Scene
from benchmarks.mapping_trials import TRIALS
from services.kernels.bricks import BRICK
from services.kernels.bricks import UNKNOWN as UNKNOWN_LOG_ODDS
from services.mapper import formats
from services.mapper.box import Box
from services.mapper.stored_map import StoredMap
from services.mapper.voxel_map import VoxelMap
from tests.octomap_reference import FREE, classes_in, inserted

pytestmark = pytest.mark.unit

VOXEL_M = 0.01
SIZES = ((640, 480), (320, 240))


@functools.lru_cache(maxsize=1)
def seen(name: str, size: tuple[int, int]) -> Scene:
    return TRIALS[name](size)


def cast(scene: Scene) -> np.ndarray:
    """Return the classes that a ray per pixel leaves."""
    ours = VoxelMap(VOXEL_M, *scene.box)
    for cloud, eye in scene.clouds():
        ours.fuse_points(cloud, eye, discretize=False)
    return classes_in(ours)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("name", TRIALS)
def test_projecting_keeps_the_contract_with_a_ray_per_pixel(
    name: str, size: tuple[int, int]
) -> None:
    scene = seen(name, size)
    ours = VoxelMap(VOXEL_M, *scene.box)
    ours.fuse_many(scene.views)
    agreement = Agreement.of(classes_in(ours), cast(scene))
    assert agreement.holds, str(agreement)


@pytest.mark.parametrize("name", TRIALS)
def test_a_ray_per_pixel_is_octomaps_on_the_same_scenes(name: str, tmp_path: Path) -> None:
    scene = seen(name, SIZES[1])
    one = Scene(scene.views[:1], scene.box)
    tree = inserted(VOXEL_M, one.clouds(), discretize=False)
    assert tree.writeBinary(str(tmp_path / "octomap.bt"))
    theirs = dense(formats.read(tmp_path / "octomap.bt"), VoxelMap(VOXEL_M, *scene.box).box)
    assert (theirs == FREE).sum() > 10_000
    np.testing.assert_array_equal(cast(one), theirs)


def dense(stored: StoredMap, box: Box) -> np.ndarray:
    """Return the classes that a file knows of a box."""
    out = np.zeros(np.array(box.shape) + 2 * BRICK, np.uint8)
    shift = np.array(stored.box.first_key) - box.first_key + BRICK
    known = np.where(stored.log_odds >= 0, 2, 1)
    classes = np.where(stored.log_odds == UNKNOWN_LOG_ODDS, 0, known).astype(np.uint8)
    for brick, voxels in zip(stored.bricks, classes, strict=True):
        i, j, k = brick.astype(int) * BRICK + shift
        if (np.array((i, j, k)) >= 0).all() and (np.array((i, j, k)) + BRICK <= out.shape).all():
            out[i : i + BRICK, j : j + BRICK, k : k + BRICK] = voxels.reshape(BRICK, BRICK, BRICK)
    return out[BRICK:-BRICK, BRICK:-BRICK, BRICK:-BRICK]
