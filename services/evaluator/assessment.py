"""One map against one instant of the truth: every figure."""

from dataclasses import dataclass

import numpy as np

from schemas.metrics import Missing, Score
from services.evaluator.metrics import (
    FloatArray,
    above_ground,
    chamfer,
    missing,
    nearest_voxel,
    score,
)
from services.evaluator.surface import BoolArray
from services.evaluator.truth import Instant
from services.evaluator.views import View
from services.evaluator.visibility import visibility

HEADLINE = 1
"""Which of the two scores counts: the tolerance of two voxels."""


@dataclass(frozen=True)
class Assessment:
    """What `schemas.metrics.Quality` says of one instant."""

    scores: tuple[Score, Score]
    """Tolerances resolution and 2 x resolution. At one voxel the grid itself limits the figure: a
    surface point may be sqrt(3)/2 voxels from its own voxel's centre."""
    missing: Missing
    """At the wider tolerance."""
    accuracy_m: float | None
    completeness_m: float | None
    chamfer_m: float | None
    num_voxels: int
    """Scored; the ground's are not."""


def assess(
    centres_m: FloatArray,
    resolution_m: float,
    instant: Instant,
    observable: BoolArray,
    views: list[View],
) -> Assessment:
    """Compare occupied voxels with the surface.

    Args:
        centres_m: (M, 3) centres of the occupied voxels, target frame of that instant.
        resolution_m: edge of a voxel.
        instant: the surface and its samples.
        observable: (N,) of the samples.
        views: the cameras at that instant.
    """
    placed = instant.placed
    centres = above_ground(centres_m, resolution_m)
    nearest = nearest_voxel(placed.points_m, centres)
    ghosts = instant.distance(centres)
    sight = visibility(instant.surface, placed, views)
    fine, wide = (
        score(nearest, ghosts, placed.weights, observable, sight.seen(), factor * resolution_m)
        for factor in (1, 2)
    )
    empty = not len(centres)
    accuracy = None if empty else float(np.mean(ghosts, dtype=np.float64))
    completeness = None if empty else float(np.average(nearest, weights=placed.weights))
    return Assessment(
        scores=(fine, wide),
        missing=missing(nearest, placed.weights, sight, 2 * resolution_m),
        accuracy_m=accuracy,
        completeness_m=completeness,
        chamfer_m=(
            None if accuracy is None or completeness is None else chamfer(accuracy, completeness)
        ),
        num_voxels=len(centres),
    )
