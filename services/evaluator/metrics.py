"""The figures: a map's voxels against the surface's samples.

P are samples of the surface, Q the centres of occupied voxels, d(x, S) the least distance.
Source of the definitions: Knapitsch et al., Tanks and Temples, ACM ToG 36(4), 2017, sec. 4.2.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from schemas.metrics import Missing, Score
from services.evaluator.surface import BoolArray, Float32Array
from services.evaluator.visibility import GRAZING_RAD, Visibility

FloatArray = NDArray[np.float64]

GROUND_CLEARANCE_VOXELS = 1.0


def above_ground(centres_m: FloatArray, resolution_m: float) -> FloatArray:
    """Leave out the voxels that hold the ground, which the map cannot tell from the object.

    A voxel stays when its centre is at least one voxel above z = 0: the layers that touch the
    plane, or its noise, go. What goes counts neither as a ghost nor for the coverage, so the
    ground cannot pay for the object's feet.

    Args:
        centres_m: (M, 3) voxel centres, target frame.
        resolution_m: edge of a voxel.
    """
    return centres_m[centres_m[:, 2] >= GROUND_CLEARANCE_VOXELS * resolution_m]


def nearest_voxel(points_m: Float32Array, centres_m: FloatArray) -> FloatArray:
    """Return (N,) d(p, Q) in metres; infinite when there is no voxel."""
    if not len(centres_m):
        return np.full(len(points_m), np.inf)
    # A quick tree, for it is asked once: the options only trade building against asking.
    tree = cKDTree(centres_m, leafsize=32, balanced_tree=False)
    distance: FloatArray = tree.query(points_m)[0]
    return distance


def recall(
    nearest_m: FloatArray,
    weights: Float32Array,
    tolerance_m: float,
    subset: BoolArray | None = None,
) -> float:
    """Return the share of the (sub)surface with a voxel closer than the tolerance.

    Of an empty subset nothing is missing: 1.
    """
    counted = weights if subset is None else np.where(subset, weights, 0.0)
    total = float(counted.sum(dtype=np.float64))
    if total <= 0:
        return 1.0
    covered = float(counted[nearest_m < tolerance_m].sum(dtype=np.float64))
    return min(1.0, covered / total)


def precision(ghost_m: Float32Array, tolerance_m: float) -> float:
    """Return the share of voxels closer to the surface than the tolerance.

    An empty map claims nothing that is false: 1.
    """
    return float(np.mean(ghost_m < tolerance_m)) if len(ghost_m) else 1.0


def f_score(precision: float, recall: float) -> float:
    """Return the harmonic mean 2 P R / (P + R)."""
    total = precision + recall
    return min(1.0, 2 * precision * recall / total) if total > 0 else 0.0


def chamfer(accuracy_m: float, completeness_m: float) -> float:
    """Return CD-L1: half the sum of both mean distances (many papers take the sum)."""
    return (accuracy_m + completeness_m) / 2


def score(
    nearest_m: FloatArray,
    ghost_m: Float32Array,
    weights: Float32Array,
    observable: BoolArray,
    visible: BoolArray,
    tolerance_m: float,
) -> Score:
    """Gather the figures at one tolerance.

    Args:
        nearest_m: (N,) d(p, Q), surface to voxels.
        ghost_m: (M,) d(q, surface), voxels to surface.
        weights: (N,) shares of the surface.
        observable: (N,) seen from some admissible view.
        visible: (N,) seen by a camera at this instant.
        tolerance_m: tau.
    """
    coverage = recall(nearest_m, weights, tolerance_m)
    exact = precision(ghost_m, tolerance_m)
    return Score(
        tolerance_m=tolerance_m,
        coverage=coverage,
        coverage_observable=recall(nearest_m, weights, tolerance_m, observable),
        coverage_visible=recall(nearest_m, weights, tolerance_m, visible),
        precision=exact,
        f_score=f_score(exact, coverage),
        ghost_rate=1.0 - exact,
    )


def missing(
    nearest_m: FloatArray, weights: Float32Array, visibility: Visibility, tolerance_m: float
) -> Missing:
    """Say why each missing sample is missing, by the best that any camera could do for it.

    In this order: no camera has it in its frustum; those that have it see the body in front of
    it (or its back); they see it, but only beyond `GRAZING_RAD`; they see it well, and the map
    has not got it yet. The four shares sum to 1 - coverage.
    """
    lost = ~(nearest_m < tolerance_m)
    seen = visibility.best_cosine > 0
    well = visibility.best_cosine > math.cos(GRAZING_RAD)
    total = float(weights.sum(dtype=np.float64))

    def share(reason: BoolArray) -> float:
        return float(weights[lost & reason].sum(dtype=np.float64)) / total

    return Missing(
        out_of_view=share(~visibility.in_view),
        self_occluded=share(visibility.in_view & ~seen),
        grazing=share(seen & ~well),
        not_yet_updated=share(well),
    )
