"""Runs every kernel of the mapper once, so that numba compiles or loads it now."""

import numpy as np

from services.mapper import octree_file
from services.mapper.sensor_model import SensorModel
from services.mapper.voxel_map import VoxelMap


def warm_up() -> None:
    """Fuse, publish, fade, ask and save a tiny map, with the types that real ones have."""
    tiny = VoxelMap(0.05, (-0.4, -0.4, 0.6), (0.4, 0.4, 1.4), dynamic=True)
    depth = np.full((24, 32), 900, np.uint16)
    depth[8:16] = 1200
    # Two scales of the image: windows of pixels, then of cells.
    for focal_px in (30.0, 300.0):
        tiny.fuse_depth(depth, (focal_px, focal_px, 15.5, 11.5), np.eye(4))
    tiny.fuse_depth(
        depth, (30.0, 30.0, 15.5, 11.5), np.eye(4), color=np.zeros((24, 32, 3), np.uint8)
    )
    for discretize in (True, False):
        tiny.fuse_points([(0.1, 0.0, 1.0), (9.0, 0.0, 1.0)], (0.0, 0.0, 0.0), 5.0, discretize)
    tiny.changes()
    tiny.counts()
    tiny.entropy_bits()
    tiny.classify([(0.0, 0.0, 1.0)])
    tiny.cast_rays([(0.0, 0.0, 0.0)], [(0.0, 0.0, 1.0)])
    tiny.log_odds_dense()
    tiny.set_sensor(SensorModel.from_frames(1, 1))
    for _ in range(2):
        tiny.decay(0.1, 1.0)
        tiny.changes()
    if tiny.num_dynamic:
        tiny.dynamic()
    octree_file.ot_bytes(tiny.stored())
    octree_file.bt_bytes(tiny.stored())
