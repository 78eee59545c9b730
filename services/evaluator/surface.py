"""A triangle surface that answers how far a point is from it and what it hides."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.evaluator.open3d_loader import open3d

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_THREADS = 1  # The evaluator runs beside the services that it measures.
_RAY_START = 1e-4  # Of the ray's length: past the own triangle, 0.1 mm at 1 m.


class Surface:
    """A mesh in the target frame; its tree (Embree's BVH) is built at the first question.

    Args:
        vertices_m: (V, 3) metres.
        faces: (F, 3) vertex indices, counter-clockwise seen from outside.
    """

    def __init__(self, vertices_m: ArrayLike, faces: ArrayLike) -> None:
        self.vertices_m: Float32Array = np.ascontiguousarray(vertices_m, np.float32)
        self.faces: IntArray = np.ascontiguousarray(faces, np.int64)

    @cached_property
    def _scene(self) -> Any:
        o3d = open3d()
        scene = o3d.t.geometry.RaycastingScene(nthreads=_THREADS)
        scene.add_triangles(_tensor(self.vertices_m), _tensor(self.faces.astype(np.uint32)))
        return scene

    @cached_property
    def face_vectors(self) -> Float32Array:
        """(F, 3) normals, outward, as long as twice the triangle's area (m^2)."""
        a, b, c = (self.vertices_m[self.faces[:, corner]] for corner in range(3))
        vectors: Float32Array = np.cross(b - a, c - a)
        return vectors

    def distance(self, points_m: ArrayLike) -> Float32Array:
        """Return the exact distance (N,), metres, of (N, 3) points to the nearest triangle."""
        points = np.ascontiguousarray(points_m, np.float32)
        if not len(points):
            return np.empty(0, np.float32)
        out: Float32Array = self._scene.compute_distance(_tensor(points), _THREADS).numpy()
        return out

    def occluded(self, points_m: Float32Array, eyes_m: Float32Array) -> BoolArray:
        """Return (N,) whether the surface stands between each point on it and its eye.

        Args:
            points_m: (N, 3) points on the surface, float32.
            eyes_m: (N, 3) where each is looked at from, float32.
        """
        if not len(points_m):
            return np.empty(0, np.bool_)
        rays = np.concatenate([points_m, eyes_m - points_m], axis=1)
        out: BoolArray = self._scene.test_occlusions(
            _tensor(rays), tnear=_RAY_START, tfar=1.0, nthreads=_THREADS
        ).numpy()
        return out


def _tensor(array: NDArray[Any]) -> Any:
    return open3d().core.Tensor.from_numpy(np.ascontiguousarray(array))
