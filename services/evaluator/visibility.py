"""Which samples of the surface are seen, from where and how obliquely."""

import math
from dataclasses import dataclass

import numpy as np

from services.evaluator.samples import Placed
from services.evaluator.surface import BoolArray, Float32Array, Surface
from services.evaluator.views import View, eyes
from services.kernels.rigid import inverse

MAX_INCIDENCE_RAD = math.radians(85.0)
"""Between normal and line of sight; beyond it a pixel smears over more than eleven of its width."""
GRAZING_RAD = math.radians(75.0)
"""Beyond it depth is unreliable: a pixel's footprint is four times as long as wide."""
_EYES_AT_ONCE = 32  # Bounds memory: 32 eyes x 10 000 samples x 24 bytes is 8 MB of rays.


@dataclass(frozen=True)
class Visibility:
    """How well each sample is seen by the best of a set of cameras."""

    in_view: BoolArray
    """(N,) inside the frustum and range of at least one camera."""
    best_cosine: Float32Array
    """(N,) cosine of the least incidence over the cameras that see it; 0: none does."""

    def seen(self, max_incidence_rad: float = MAX_INCIDENCE_RAD) -> BoolArray:
        """(N,) whether a camera sees the sample, and not more obliquely than that."""
        cosine: BoolArray = self.best_cosine > math.cos(max_incidence_rad)
        return cosine


def visibility(surface: Surface, placed: Placed, views: list[View]) -> Visibility:
    """Find what cameras see of the surface at one instant.

    Seen is what lies in the frustum and the range, faces the camera, and is not hidden by the
    surface itself. The ground hides nothing from a camera above it.

    Args:
        surface: the mesh, target frame.
        placed: its samples at the same instant.
        views: the cameras, same frame.
    """
    inside = np.array([in_frustum(placed.points_m, view) for view in views], np.bool_)
    inside = inside.reshape(-1, len(placed.points_m))
    in_view: BoolArray = np.any(inside, axis=0)
    return Visibility(in_view, _best_cosine(surface, placed, eyes(views), inside))


def observable(surface: Surface, placed: Placed, eyes_m: Float32Array) -> BoolArray:
    """Find which samples are seen from at least one of many viewpoints, wherever it looks.

    Args:
        surface: the mesh.
        placed: its samples.
        eyes_m: (M, 3) viewpoints, the surface's frame.

    Returns:
        (N,) seen at an incidence below `MAX_INCIDENCE_RAD`.
    """
    best = np.zeros(len(placed.points_m), np.float32)
    for start in range(0, len(eyes_m), _EYES_AT_ONCE):
        some = eyes_m[start : start + _EYES_AT_ONCE]
        # What an earlier viewpoint has seen well enough needs no further ray.
        missing = best <= math.cos(MAX_INCIDENCE_RAD)
        candidates = np.broadcast_to(missing, (len(some), len(best)))
        best = np.maximum(best, _best_cosine(surface, placed, some, candidates))
    seen: BoolArray = best > math.cos(MAX_INCIDENCE_RAD)
    return seen


def in_frustum(points_m: Float32Array, view: View) -> BoolArray:
    """Return (N,) which (N, 3) points, target frame, fall on the image and in the range."""
    T_camera_target = inverse(view.T_target_camera).astype(np.float32)
    x, y, z = T_camera_target[:3, :3] @ points_m.T + T_camera_target[:3, 3:]
    k = view.intrinsics
    near, far = view.min_range_m, view.max_range_m
    depth = np.where(z > 0, z, np.inf)
    u, v = k.fx * x / depth + k.cx, k.fy * y / depth + k.cy
    # Integers are pixel centres: the image reaches from -0.5 to size - 0.5.
    across = (u >= -0.5) & (u < k.width - 0.5) & (v >= -0.5) & (v < k.height - 0.5)
    inside: BoolArray = across & (z > 0) & (z >= near) & (z <= far)
    return inside


def _best_cosine(
    surface: Surface, placed: Placed, eyes_m: Float32Array, candidates: BoolArray
) -> Float32Array:
    """(N,) best cosine over (M, 3) eyes, of the (M, N) candidates that no triangle hides."""
    points, normals = placed.points_m, placed.normals
    facing = eyes_m @ normals.T - np.einsum("nd,nd->n", points, normals)
    eye, sample = np.nonzero(candidates & (facing > 0))
    # One batch for all cameras, and only for what faces them: half of the rays or fewer.
    starts, ends = points[sample], eyes_m[eye]
    hidden = surface.occluded(starts, ends)
    sight = ends - starts
    cosine = facing[eye, sample] / np.sqrt(np.einsum("nd,nd->n", sight, sight))
    best = np.zeros(len(points), np.float32)
    np.maximum.at(best, sample[~hidden], cosine[~hidden])
    return best
