"""Draws a mesh that stands on the ground, as a camera sees it."""

import numpy as np
from numpy.typing import NDArray

from schemas.camera import Intrinsics
from services.kernels.ground import fill_ground
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import FloatArray

_NEAR_M = 0.01  # Nearer surfaces are cut; nearer than the minimum range they still hide others.
_NO_FACE = -1


class Renderer:
    """Buffers of one camera, filled anew by each `draw`."""

    def __init__(self, intrinsics: Intrinsics, max_range_m: float) -> None:
        k = intrinsics
        self.intrinsics = np.array([k.fx, k.fy, k.cx, k.cy])
        self.depth_m: NDArray[np.float32] = np.empty((k.height, k.width), np.float32)
        """(H, W) along the optical axis, inf = nothing in range."""
        self.triangle: NDArray[np.int32] = np.empty((k.height, k.width), np.int32)
        """(H, W) face seen, -1 = the ground or nothing."""
        self.vertices_camera_m: FloatArray = np.empty((0, 3))
        """(V, 3) in the optical frame."""
        self._max_range_m = max_range_m

    def draw(
        self,
        vertices_world_m: NDArray[np.float32],
        faces: NDArray[np.int32],
        T_world_camera: FloatArray,
    ) -> None:
        """Fill the buffers with the (V, 3) vertices' (F, 3) faces and the ground."""
        if len(self.vertices_camera_m) != len(vertices_world_m):
            self.vertices_camera_m = np.empty(vertices_world_m.shape)
        to_camera(vertices_world_m, T_world_camera, self.vertices_camera_m)
        fill_ground(T_world_camera, self.intrinsics, _NEAR_M, self._max_range_m, self.depth_m)
        self.triangle.fill(_NO_FACE)
        rasterise(
            self.vertices_camera_m, faces, self.intrinsics, _NEAR_M, self.depth_m, self.triangle
        )
