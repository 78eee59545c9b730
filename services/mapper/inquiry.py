"""Answers to requests about the map, in the frame that the request names."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import apply, inverse
from services.mapper.errors import TooMuchAsked
from services.mapper.fusion import Fusion
from services.mapper.questions import Bounds, part_of
from services.mapper.requests import (
    MAX_FIELD_VOXELS,
    MAX_LOOKED_AT,
    CastRays,
    Classify,
    Distance,
    Entropy,
    Frame,
    packed,
)

Answer = dict[str, Any]


class Inquiry:
    """Asks the map of a fusion; `world` is where the map's frame was at the last instant."""

    def __init__(self, fusion: Fusion) -> None:
        self._fusion = fusion

    def classify(self, asked: Classify) -> Answer:
        """Return `classes` (N,): 0 unknown, 1 free, 2 occupied."""
        points = _moved(self._T_map(asked.frame), asked.points_m.array)
        classes = self._fusion.voxel_map.classify(points)
        return {"frame": asked.frame, "classes": asked.points_m.answer(classes)}

    def cast_rays(self, asked: CastRays) -> Answer:
        """Return `outcome` (N,), `points_m` (N, 3), `distance_m` (N,) as `RayHits` has them."""
        T_map_asked = self._T_map(asked.frame)
        hits = self._fusion.voxel_map.cast_rays(
            _moved(T_map_asked, asked.origins_m.array),
            _rotated(T_map_asked, asked.directions.array),
            np.inf if asked.max_range_m is None else asked.max_range_m,
            asked.unknown_stops,
        )
        answer = asked.origins_m.answer
        return {
            "frame": asked.frame,
            "outcome": answer(hits.outcome),
            "points_m": answer(apply(inverse(T_map_asked), hits.points_m)),
            "distance_m": answer(hits.distance_m),
            "num_invalid": hits.num_invalid,
        }

    def distance(self, asked: Distance) -> Answer:
        """Return `distance_m`: (N,) of points; or (nx, ny, nz) packed, with `origin_m`."""
        voxel_map = self._fusion.voxel_map
        if asked.points_m is not None:
            points = _moved(self._T_map(asked.frame), asked.points_m.array)
            distance_m = voxel_map.distance(points, asked.reach_m, asked.unknown_is)
            return {"frame": asked.frame, "distance_m": asked.points_m.answer(distance_m)}
        self._check_size(asked.bounds_m, asked.reach_m)
        field, origin_m = voxel_map.distance_field(asked.bounds_m, asked.reach_m, asked.unknown_is)
        return {
            "frame": asked.frame,
            "distance_m": packed(field),
            "origin_m": origin_m.tolist(),
            "resolution_m": voxel_map.box.resolution_m,
        }

    def entropy(self, asked: Entropy) -> Answer:
        """Return `entropy_bits` and the `num_voxels` it is the sum over."""
        voxel_map = self._fusion.voxel_map
        num_voxels = voxel_map.box.num_voxels
        if asked.bounds_m is not None:
            num_voxels = part_of(voxel_map.box, asked.bounds_m).num_voxels
        bits = voxel_map.entropy_bits(asked.bounds_m)
        return {"frame": "map", "entropy_bits": bits, "num_voxels": num_voxels}

    def _check_size(self, bounds_m: Bounds | None, reach_m: float) -> None:
        box = self._fusion.voxel_map.box
        answered = part_of(box, bounds_m).num_voxels
        if answered > MAX_FIELD_VOXELS:
            raise TooMuchAsked(
                f"bounds_m hold {answered} voxels; an answer holds at most {MAX_FIELD_VOXELS}: "
                "ask for parts"
            )
        looked_at = part_of(box, bounds_m, reach_m).num_voxels
        if looked_at > MAX_LOOKED_AT:
            raise TooMuchAsked(
                f"within reach_m {reach_m} of bounds_m lie {looked_at} voxels; the mapper looks at "
                f"{MAX_LOOKED_AT} at most: ask with a smaller reach_m"
            )

    def _T_map(self, frame: Frame) -> NDArray[np.float64]:
        """Return T_map_frame."""
        return np.eye(4) if frame == "map" else inverse(self._fusion.T_world_map)


def _rotated(T: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    turn = np.eye(4)
    turn[:3, :3] = T[:3, :3]
    return _moved(turn, directions)


def _moved(T: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", over="ignore"):  # What is not finite is answered so.
        return apply(T, points)
