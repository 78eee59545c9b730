"""How to look at a scene: where it is, how large, how deep."""

from dataclasses import dataclass

import numpy as np

from schemas.cloud import DepthCloud
from services.kernels.rigid import FloatArray
from services.recorder.export.depth_picture import depth_reach
from services.recorder.export.moment import Moment
from services.recorder.export.voxel_squares import is_ground

_DEFAULT_RADIUS_M = 1.0


@dataclass(frozen=True, eq=False)
class Frame:
    """What was seen first, and stays: where the scene is, how large, how deep."""

    centre_m: FloatArray
    """(3,) the middle of the ring, world."""
    radius_m: float
    """Of the ring of cameras."""
    top_m: float
    """Height of what is mapped."""
    reach_m: tuple[float, float]
    """Between which most depths are."""


def framed(moment: Moment) -> Frame:
    """Return how to look at a scene of which this is the first moment."""
    centre, top_m = middle(moment), 0.4
    if len(moment.mirror):
        heights = moment.mirror.centres() @ moment.T_world_map[2, :3] + moment.T_world_map[2, 3]
        top_m = max(float(heights.max()), 1e-3)
    eyes = np.array([T[:3, 3] for T in moment.poses.values()]).reshape(-1, 3)
    radius_m = _DEFAULT_RADIUS_M
    if len(eyes):
        radius_m = max(float(np.linalg.norm(eyes - centre, axis=1).max()), 1e-3)
    elif moment.formation is not None and moment.formation.radius_m > 0:
        radius_m = moment.formation.radius_m
    elif len(moment.mirror):
        radius_m = max(float(np.ptp(moment.mirror.centres(), axis=0).max()), 1e-3)
    reaches = [
        reach
        for cloud in moment.clouds.values()
        if isinstance(cloud, DepthCloud) and (reach := depth_reach(cloud)) is not None
    ]
    near, far = (min(r[0] for r in reaches), max(r[1] for r in reaches)) if reaches else (0.1, 5.0)
    return Frame(centre, radius_m, top_m, (near, far))


def num_drawn(moment: Moment) -> int:
    """Count the occupied voxels that are not of the ground."""
    latest = moment.mirror.latest
    if latest is None:
        return 0
    T = moment.T_world_map
    centres_m = moment.mirror.centres() @ T[:3, :3].T + T[:3, 3]
    return int((~is_ground(centres_m, latest.resolution_m)).sum())


def middle(moment: Moment, default_m: FloatArray | None = None) -> FloatArray:
    """Return (3,) what the cameras look at, world."""
    if moment.formation is not None:
        return np.asarray(moment.formation.centre, np.float64)
    if moment.T_world_target is not None:
        return moment.T_world_target[:3, 3] + (0.0, 0.0, 0.2)
    if len(moment.mirror):
        T = moment.T_world_map
        middle: FloatArray = T[:3, :3] @ moment.mirror.centres().mean(axis=0) + T[:3, 3]
        return middle
    return np.zeros(3) if default_m is None else default_m
