"""Nothing is left of what has moved once cameras have looked through it for as many frames."""

import numpy as np
import pytest

from services.mapper.sensor_model import SensorModel
from services.mapper.voxel_map import VoxelMap
from tests.ball_scene import EYES, PINHOLE, image, look_at

pytestmark = pytest.mark.unit

RESOLUTION_M = 0.04
BOUNDS = ((-0.8, -0.64, 0.0), (0.8, 0.64, 0.64))
RADIUS_M = 0.16
NUM_RESTING = 12


def seen_through(depth: np.ndarray, T: np.ndarray, centres_m: np.ndarray) -> np.ndarray:
    """(N,) whether the pixel on a voxel's centre returned from more than a voxel behind it."""
    x, y, z = ((centres_m - T[:3, 3]) @ T[:3, :3]).T
    fx, fy, cx, cy = PINHOLE
    u, v = np.round(fx * x / z + cx).astype(int), np.round(fy * y / z + cy).astype(int)
    inside = (z > 0.1) & (u >= 0) & (v >= 0) & (u < depth.shape[1]) & (v < depth.shape[0])
    reach_m = np.zeros(len(z))
    reach_m[inside] = depth[v[inside], u[inside]] * 0.001
    return reach_m > z + RESOLUTION_M


def hit(depth: np.ndarray, T: np.ndarray, voxels: VoxelMap) -> np.ndarray:
    """(V,) whether a return ends in a voxel, or in a neighbour within rounding."""
    v, u = np.nonzero((depth > 0) & (depth < 65535))
    z = depth[v, u] * 0.001
    fx, fy, cx, cy = PINHOLE
    points = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1) @ T[:3, :3].T + T[:3, 3]
    ends = np.zeros(voxels.box.shape, bool)
    for shift in (-1e-5, 1e-5):
        keys = voxels.box.keys(points + shift)
        ends[tuple(keys[((keys >= 0) & (keys < voxels.box.shape)).all(axis=1)].T)] = True
    return ends.ravel()


@pytest.mark.parametrize("num_cameras", [1, 4])
@pytest.mark.parametrize(("to_clear", "to_appear"), [(1, 1), (3, 1), (2, 3)])
def test_after_frames_to_clear_there_are_no_ghosts(
    num_cameras: int, to_clear: int, to_appear: int
) -> None:
    rng = np.random.default_rng(3)
    voxels = VoxelMap(RESOLUTION_M, *BOUNDS, SensorModel.from_frames(to_clear, to_appear))
    octomap = VoxelMap(RESOLUTION_M, *BOUNDS)
    centres_m = voxels.box.centres_m(np.argwhere(np.ones(voxels.box.shape)))
    looks = np.zeros(len(centres_m), int)
    ghosts_of_octomap = 0
    for n in range(NUM_RESTING + 20):
        x = -0.4 + 0.05 * max(n - NUM_RESTING, 0)
        ball = np.array([x, 0.0, RADIUS_M])
        through, was_hit = np.zeros(len(centres_m), bool), np.zeros(len(centres_m), bool)
        for eye in EYES[:num_cameras]:
            T = look_at(eye)
            depth = image(T, [(ball, RADIUS_M)], rng.normal(size=(120, 160)))
            for m in (voxels, octomap):
                m.fuse_depth(depth, PINHOLE, T)
            through |= seen_through(depth, T, centres_m)
            was_hit |= hit(depth, T, voxels)
        looks = np.where(was_hit, 0, looks + through)
        gone = looks >= to_clear
        assert gone.sum() > 1000 or n < to_clear
        assert not (voxels.classify(centres_m[gone]) == 2).any()
        ghosts_of_octomap += int((octomap.classify(centres_m[gone]) == 2).sum())
    assert ghosts_of_octomap > 30 or to_clear > 3
