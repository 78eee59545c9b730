"""Runs every kernel of the simulated camera once, so that numba compiles or loads it now."""

import numpy as np

from schemas.camera import Intrinsics
from services.camera.sources.depth_sensor import DepthSensor, DepthSettings
from services.camera.sources.renderer import Renderer
from services.kernels.rigid import look_at
from services.kernels.shade import bake, noise_lattice, shade, vertex_normals


def warm_up() -> None:
    """Draw, report and shade a triangle on a tiny image, with the types that real ones have."""
    renderer = Renderer(Intrinsics.from_vertical_fov(16, 12, 0.8), 5.0)
    vertices = np.array([[0, 0, 0.1], [0, 0.1, 0.1], [0, 0, 0.3]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    # What is loaded from a scene is read-only, which is another type to numba.
    faces.setflags(write=False)
    T_world_camera = look_at((1.0, 0.0, 0.5), (0.0, 0.0, 0.2))
    renderer.draw(vertices, faces, T_world_camera)
    for settings in (DepthSettings(noise="ideal"), DepthSettings(noise="nguyen")):
        DepthSensor(settings, 0, 0).report(renderer, faces, 0.5, 0)
    _shade(renderer, vertices, faces, T_world_camera)


def _shade(
    drawn: Renderer,
    vertices: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    faces: np.ndarray[tuple[int, ...], np.dtype[np.int32]],
    T_world_camera: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> None:
    lattice, albedo = noise_lattice(0), np.empty(len(vertices), np.float32)
    rest = vertices.copy()
    rest.setflags(write=False)
    bake(rest, lattice, albedo)
    normals = np.empty(vertices.shape)
    vertex_normals(vertices, faces, normals)
    bgr = np.empty((*drawn.depth_m.shape, 3), np.uint8)
    light = np.array([0.0, 0.0, 1.0])
    shade(drawn.depth_m, drawn.triangle, vertices, faces, normals, albedo, lattice, light,
          T_world_camera, drawn.intrinsics, bgr)  # fmt: skip
