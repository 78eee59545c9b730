"""Open3D's ray caster as the independent judge of our images."""

import numpy as np

from services.evaluator.open3d_loader import open3d


class RayCaster:
    """Depth images of one mesh."""

    def __init__(self, vertices_m, faces):
        self._o3d = open3d()
        self._scene = self._o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._o3d.core.Tensor(np.ascontiguousarray(vertices_m, np.float32)),
            self._o3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
        )

    def depth_m(self, T_world_camera, intrinsics, width, height):
        """Return the (H, W) depth along the optical axis, inf = nothing."""
        fx, fy, cx, cy = intrinsics
        # Open3D's pixel centres are at +0.5. Its rays have z = 1 in the camera: t is the depth.
        K = np.array([[fx, 0, cx + 0.5], [0, fy, cy + 0.5], [0, 0, 1]])
        rays = self._scene.create_rays_pinhole(
            self._o3d.core.Tensor(K),
            self._o3d.core.Tensor(np.linalg.inv(T_world_camera)),
            width,
            height,
        )
        return self._scene.cast_rays(rays)["t_hit"].numpy()
