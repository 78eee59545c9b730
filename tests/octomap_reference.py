"""OctoMap itself, as the reference of both integrators."""

import numpy as np
from pyoctomap import OcTree

from services.mapper.box import Box
from services.mapper.voxel_map import VoxelMap

UNKNOWN, FREE, OCCUPIED = 0, 1, 2


def inserted(
    resolution_m: float,
    scans: list[tuple[np.ndarray, np.ndarray]],
    max_range_m: float = -1.0,
    discretize: bool = True,
) -> OcTree:
    """Insert (points, origin) scans, map frame, m, into a new tree that is not pruned."""
    tree = OcTree(resolution_m)
    for points, origin in scans:
        tree.insertPointCloud(
            np.ascontiguousarray(points, np.float64),
            np.asarray(origin, np.float64),
            max_range_m,
            True,
            discretize,
        )
    return tree


def log_odds_in(tree: OcTree, box: Box) -> np.ndarray:
    """Return the tree's log-odds over a box, (nx, ny, nz) float32; unknown is NaN."""
    dense = np.full(box.shape, np.nan, np.float32)
    for leaf in tree.begin_leafs():
        edge = round(leaf.getSize() / box.resolution_m)
        corner = np.asarray(leaf.getCoordinate()) / box.resolution_m - edge / 2
        low = np.round(corner).astype(int) - np.asarray(box.first_key)
        i, j, k = np.clip(low, 0, None)
        a, b, c = np.clip(low + edge, 0, None)
        dense[i:a, j:b, k:c] = leaf.current_node.getLogOdds()
    return dense


def classes_of(log_odds: np.ndarray) -> np.ndarray:
    """Return classes (uint8) of log-odds whose unknown is NaN."""
    known = np.where(log_odds >= 0, OCCUPIED, FREE)
    return np.where(np.isnan(log_odds), UNKNOWN, known).astype(np.uint8)


def classes_in(voxel_map: VoxelMap) -> np.ndarray:
    """Return the classes of all voxels of a map."""
    return classes_of(voxel_map.log_odds_dense())


def iou(ours: np.ndarray, theirs: np.ndarray, of: int) -> float:
    """Return intersection over union of the voxels of one class."""
    return ((ours == of) & (theirs == of)).sum() / ((ours == of) | (theirs == of)).sum()
