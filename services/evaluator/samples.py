"""Points spread evenly over a surface, tied to its triangles so that they move with them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.evaluator.surface import Float32Array, IntArray, Surface

# The plastic number's inverse powers: the 2-D low-discrepancy sequence of Roberts, "The
# unreasonable effectiveness of quasirandom sequences", 2018.
_R2 = (0.7548776662466927, 0.5698402909980532)
_SMALLEST_AREA_M2 = 1e-30


@dataclass(frozen=True)
class Samples:
    """Where the samples are on the mesh, whatever its pose or shape."""

    face: IntArray
    """(N,) triangle."""
    barycentric: Float32Array
    """(N, 3) weights of its corners."""
    rest_area_m2: Float32Array
    """(N,) the triangle's area where the samples were drawn."""


@dataclass(frozen=True)
class Placed:
    """Samples at one instant, in the surface's frame."""

    points_m: Float32Array
    """(N, 3)."""
    normals: Float32Array
    """(N, 3) unit, outward, of the triangle: what a ray meets."""
    weights: Float32Array
    """(N,) share of the surface that each stands for, sum 1: a triangle that the deformation
    stretched has not got more samples, so each counts for more."""


def sample(surface: Surface, num: int, seed: int) -> Samples:
    """Draw samples uniformly by area.

    Systematic along the faces' cumulated area (every face gets its share of samples to within
    one), quasi-random within the triangle, both shifted by the seed.

    Args:
        surface: in its rest pose.
        num: how many.
        seed: same seed, same samples.

    Raises:
        ValueError: If `num` is not positive or the surface has no area.
    """
    area = np.linalg.norm(surface.face_vectors, axis=1).astype(np.float64) / 2
    cumulated = np.cumsum(area)
    if num < 1 or not len(area) or not cumulated[-1] > 0:
        raise ValueError(f"cannot draw {num} samples from a surface of {len(area)} triangles")
    shift = np.random.default_rng(seed).random(3)
    index = np.arange(num)
    along = (index + shift[0]) / num * cumulated[-1]
    face = np.minimum(np.searchsorted(cumulated, along, side="right"), len(area) - 1)
    u, v = (np.mod(shift[1 + axis] + index * _R2[axis], 1.0) for axis in range(2))
    root = np.sqrt(u)  # Turk, Graphics Gems 1990: uniform in a triangle.
    barycentric = np.stack([1 - root, root * (1 - v), root * v], axis=1)
    return Samples(face, barycentric.astype(np.float32), area[face].astype(np.float32))


def place(samples: Samples, surface: Surface) -> Placed:
    """Put the samples where their triangles are now.

    Args:
        samples: drawn from a surface with the same faces.
        surface: posed and deformed.
    """
    corners = surface.vertices_m[surface.faces[samples.face]]
    points = np.einsum("nc,ncd->nd", samples.barycentric, corners)
    vectors = surface.face_vectors[samples.face]
    double_area: NDArray[np.float32] = np.sqrt(np.einsum("nd,nd->n", vectors, vectors))
    double_area = np.maximum(double_area, np.float32(_SMALLEST_AREA_M2))
    stretch = double_area / (2 * samples.rest_area_m2)
    return Placed(points, vectors / double_area[:, None], stretch / stretch.sum())
