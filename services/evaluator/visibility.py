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
_EYES_AT_ONCE = 32  # Bounds memory: 32 eyes x 10 000 samples x 4 bytes is 1.3 MB.


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
    seen: BoolArray = np.zeros(len(placed.points_m), np.bool_)
    for start in range(0, len(eyes_m), _EYES_AT_ONCE):
        some = eyes_m[start : start + _EYES_AT_ONCE]
        # What an earlier viewpoint has seen needs no further ray.
        candidates = np.broadcast_to(~seen, (len(some), len(seen)))
        best = _best_cosine(surface, placed, some, candidates)
        seen |= best > math.cos(MAX_INCIDENCE_RAD)
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
    cosine = np.where(candidates, _cosines(placed, eyes_m), np.float32(0))
    best = np.zeros(len(placed.points_m), np.float32)
    pending = np.arange(len(best)) if len(eyes_m) else np.empty(0, np.int64)
    # Each sample asks its best eye first, and only if that is blocked the next: mostly one ray
    # per sample instead of one per pair. A round is one batch for all eyes.
    while len(pending):
        eye = cosine[:, pending].argmax(axis=0)
        value = cosine[eye, pending]
        eye, pending = eye[value > 0], pending[value > 0]
        hidden = surface.occluded(placed.points_m[pending], eyes_m[eye])
        best[pending[~hidden]] = value[value > 0][~hidden]
        eye, pending = eye[hidden], pending[hidden]
        cosine[eye, pending] = 0
    return best


def _cosines(placed: Placed, eyes_m: Float32Array) -> Float32Array:
    """(M, N) cosine of the incidence at which each of (M, 3) eyes would see each sample."""
    points, normals = placed.points_m, placed.normals
    along_normal = eyes_m @ normals.T - np.einsum("nd,nd->n", points, normals)
    squared = np.einsum("nd,nd->n", points, points) - 2 * (eyes_m @ points.T)
    squared += np.einsum("md,md->m", eyes_m, eyes_m)[:, None]
    cosine: Float32Array = along_normal / np.sqrt(np.maximum(squared, np.float32(1e-12)))
    return cosine
