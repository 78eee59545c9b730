"""Colour pictures of what the renderer drew."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.camera.sources.renderer import Renderer
from services.kernels.rigid import FloatArray
from services.kernels.shade import bake, noise_lattice, shade, vertex_normals
from services.runtime.errors import MissingExtra
from services.world.scene import Scene

_LIGHT = np.array([0.4, 0.3, 0.866]) / np.linalg.norm([0.4, 0.3, 0.866])
_JPEG_QUALITY = 85


class Painter:
    """Shades and packs pictures.

    Raises:
        MissingExtra: If OpenCV is not installed.
    """

    def __init__(self) -> None:
        self._cv2 = _opencv()
        self._scene: Scene | None = None
        self._lattice: NDArray[np.float32] = np.empty((0, 0, 0), np.float32)
        self._albedo: NDArray[np.float32] = np.empty(0, np.float32)

    def jpeg(
        self,
        drawn: Renderer,
        scene: Scene,
        vertices_world_m: NDArray[np.float32],
        T_world_camera: FloatArray,
    ) -> NDArray[np.uint8]:
        """Return the bytes of a JPEG picture of the scene that `drawn` shows."""
        if scene is not self._scene:
            self._scene, self._lattice = scene, noise_lattice(scene.spec.seed)
            self._albedo = np.empty(len(scene.rest.vertices_m), np.float32)
            bake(scene.rest.vertices_m, self._lattice, self._albedo)
        normals = np.empty(vertices_world_m.shape)
        vertex_normals(vertices_world_m, scene.faces, normals)
        bgr = np.empty((*drawn.depth_m.shape, 3), np.uint8)
        shade(
            drawn.depth_m,
            drawn.triangle,
            vertices_world_m,
            scene.faces,
            normals,
            self._albedo,
            self._lattice,
            _LIGHT,
            T_world_camera,
            drawn.intrinsics,
            bgr,
        )
        flags = [self._cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        packed: NDArray[np.uint8] = self._cv2.imencode(".jpg", bgr, flags)[1]
        return packed.reshape(-1)


def _opencv() -> Any:
    try:
        import cv2
    except ImportError as error:
        raise MissingExtra(
            f"colour pictures need OpenCV ({error}): pip install 'encircle[color]'"
        ) from error
    return cv2
