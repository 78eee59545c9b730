"""A body that crosses the space between six noisy depth cameras, and what is true meanwhile."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.camera import Intrinsics
from schemas.sim import DeformationSpec, SceneSpec
from services.camera.sources.depth_sensor import DepthSensor, DepthSettings
from services.camera.sources.renderer import Renderer
from services.evaluator.open3d_loader import open3d
from services.evaluator.samples import place, sample
from services.evaluator.surface import Surface
from services.evaluator.views import View as Eye
from services.evaluator.visibility import visibility
from services.kernels.rigid import FloatArray, apply, look_at, planar
from services.mapper.box import Box
from services.mapper.view import NO_RETURN, View
from services.world.scene import Scene

NUM_CAMERAS = 6
RING_M, HEIGHT_M = 1.3, 0.4
VFOV_RAD = math.radians(50)
WALL_M, CEILING_M = 1.7, 1.9
BOUNDS = ((-0.6, -0.6, -0.1), (0.6, 0.6, 0.7))
"""The space that is mapped, m, world."""
TRACK_M = 0.95
"""The body goes from -TRACK_M to TRACK_M along x: out of the space at either end."""
RATE_HZ = 15.0
SPEED_MPS = 0.75
NUM_RESTING = 15
"""Frames that the body stands in the middle, until its voxels are at the upper clamp."""
NUM_GONE = 8
"""Frames after the body has left."""
NUM_STANDING = 60
"""Frames of a body that stays."""
NUM_SAMPLES = 4000


@dataclass(frozen=True)
class Instant:
    """What the cameras saw at an instant, and what was there."""

    views: list[View]
    body: Surface
    seen_m: FloatArray
    """(N, 3) samples of the body's surface that a camera sees, within the space, world."""


class MovingScene:
    """A body on the ground, in the open or in a closed room.

    Args:
        kind: "sphere" or "bunny". deformation: of the body, or None.
        room: walls and a ceiling, so that every ray returns; in the open what is
            behind the body is often out of range.
        cameras: the first of six on a ring.
        moves: whether it crosses the space; else it stands in its middle.
    """

    def __init__(
        self,
        kind: str,
        size: tuple[int, int],
        *,
        room: bool,
        cameras: int = NUM_CAMERAS,
        moves: bool = True,
        deformation: DeformationSpec | None = None,
        seed: int = 0,
    ) -> None:
        deformations = () if deformation is None else (deformation,)
        spec = SceneSpec(
            object=kind, height_m=0.3, subdivide=2, deformations=deformations, seed=seed
        )
        self._scene, self._room = Scene.from_spec(spec), room
        self._optics = Intrinsics.from_vertical_fov(*size, VFOV_RAD)
        self._settings = DepthSettings(noise="nguyen", max_range_m=5.0)
        self._renderer = Renderer(self._optics, self._settings.max_range_m)
        self._sensors = [DepthSensor(self._settings, seed, k) for k in range(cameras)]
        angles = (np.arange(cameras) + 0.5) * 2 * math.pi / NUM_CAMERAS
        self._poses = [
            look_at((RING_M * math.cos(a), RING_M * math.sin(a), HEIGHT_M), (0, 0, 0.15))
            for a in angles
        ]
        rest = Surface(self._scene.mesh_at(0.0), self._scene.faces)
        self._samples = sample(rest, NUM_SAMPLES, seed)
        step_m = SPEED_MPS / RATE_HZ
        there = np.arange(-TRACK_M, 0.0, step_m)
        stops = (there, np.zeros(NUM_RESTING), -there[::-1], np.full(NUM_GONE, TRACK_M))
        self._x_m = np.concatenate(stops) if moves else np.zeros(NUM_STANDING)
        self.num_instants = len(self._x_m)

    def instant(self, n: int) -> Instant:
        """Render instant n."""
        pose = planar(float(self._x_m[n]), 0.0, 0.4)
        vertices = self._scene.vertices_world(n / RATE_HZ, pose)
        faces, drawn = self._scene.faces, vertices
        if self._room:
            walls, quads = closed_room()
            drawn = np.concatenate([vertices, walls])
            faces = np.concatenate([faces, quads + len(vertices)])
        views = []
        k = self._optics
        for T, sensor in zip(self._poses, self._sensors, strict=True):
            self._renderer.draw(drawn, faces, T)
            depth = sensor.report(self._renderer, faces, float(T[2, 3]), n)
            views.append(View(depth, (k.fx, k.fy, k.cx, k.cy), T, 0.001, 5.0))
        body = Surface(vertices, self._scene.faces)
        placed = place(self._samples, body)
        eyes = [Eye(T, k, 0.1, 5.0) for T in self._poses]
        seen = visibility(body, placed, eyes).seen()
        inside = ((placed.points_m > BOUNDS[0]) & (placed.points_m < BOUNDS[1])).all(axis=1)
        return Instant(views, body, placed.points_m[seen & inside].astype(np.float64))


def distance_m(body: Surface, points_m: FloatArray) -> FloatArray:
    """Return how far (N, 3) points are from the body and the ground; negative in the body."""
    o3d = open3d()
    caster = o3d.t.geometry.RaycastingScene(nthreads=1)
    tensor = o3d.core.Tensor
    caster.add_triangles(tensor(body.vertices_m), tensor(body.faces.astype(np.uint32)))
    asked = tensor(points_m.astype(np.float32))
    signed = caster.compute_signed_distance(asked, nthreads=1, nsamples=3).numpy()
    return np.where(signed < 0, signed, np.minimum(signed, np.abs(points_m[:, 2])))


def closed_room() -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return the vertices and triangles of four walls and a ceiling, seen from inside."""
    w, top = WALL_M, CEILING_M
    corners = [(-w, -w), (w, -w), (w, w), (-w, w)]
    vertices = np.array([(x, y, z) for z in (0.0, top) for x, y in corners], np.float32)
    quads = [(b, a, a + 4, b + 4) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))] + [(4, 7, 6, 5)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return vertices, np.array(faces, np.int32)


def points_of(view: View) -> FloatArray:
    """Return the (N, 3) returns of an image, world, m."""
    v, u = np.nonzero((view.depth > 0) & (view.depth < NO_RETURN))
    z = view.depth[v, u] * view.scale_m
    fx, fy, cx, cy = view.pinhole
    camera = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1)
    return apply(view.T_map_camera, camera)


def looked_through(view: View, box: Box, centres_m: FloatArray) -> NDArray[np.bool_]:
    """Return (N,) whether the pixel on a voxel's centre saw something more than a voxel behind it.

    A pixel without return saw that nothing is there, a pixel that knows nothing saw nothing.
    """
    camera = apply(np.linalg.inv(view.T_map_camera), centres_m)
    fx, fy, cx, cy = view.pinhole
    z = camera[:, 2]
    u = np.round(camera[:, 0] / z * fx + cx).astype(int)
    v = np.round(camera[:, 1] / z * fy + cy).astype(int)
    height, width = view.depth.shape
    inside = (z > 0.05) & (u >= 0) & (v >= 0) & (u < width) & (v < height)
    reach_m = np.zeros(len(z))
    reach_m[inside] = np.minimum(view.depth[v[inside], u[inside]] * view.scale_m, view.max_range_m)
    return reach_m > z + box.resolution_m
