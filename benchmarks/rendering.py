"""A depth image of the bunny on the ground, ours beside Open3D's ray caster, one core each.

Both draw the same view: the bunny 1.1 m away and the ground around it. A deforming body needs a
new ray casting scene per tick; a rigid one keeps it, so both are given. What we add to the true
depth (noise, dropout, rolling edges, uint16) and colour have rows of their own.

    python benchmarks/rendering.py [--images 100] [--width 640] [--height 480]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from machine import describe

from schemas.camera import Intrinsics
from schemas.sim import DeformationSpec, SceneSpec
from services.camera.sources.depth_sensor import DepthSensor, DepthSettings
from services.camera.sources.painter import Painter
from services.camera.sources.renderer import Renderer
from services.evaluator.open3d_loader import open3d
from services.kernels.rigid import FloatArray, look_at, planar
from services.world.scene import Scene

MAX_RANGE_M = 5.0
GROUND_HALF_M = 20.0
WARM_UP = 3
# Every so many of ours one of theirs, interleaved, so that both see the same machine.
OURS_PER_THEIRS = 4


class RayCaster:
    """Open3D's RaycastingScene of a mesh on two large ground triangles."""

    def __init__(self, faces: np.ndarray, optics: Intrinsics, T_world_camera: FloatArray) -> None:
        self._o3d = open3d()
        self._faces, self._optics = faces, optics
        k = optics
        self._K = np.array([[k.fx, 0, k.cx + 0.5], [0, k.fy, k.cy + 0.5], [0, 0, 1]])
        self._T = np.linalg.inv(T_world_camera)

    def build(self, vertices_m: np.ndarray) -> None:
        """Build the scene anew."""
        h, n = GROUND_HALF_M, len(vertices_m)
        ground = np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]], np.float32)
        faces = np.concatenate([self._faces, [[n, n + 1, n + 2], [n, n + 2, n + 3]]])
        self._scene = self._o3d.t.geometry.RaycastingScene(nthreads=1)
        tensor = self._o3d.core.Tensor
        self._scene.add_triangles(
            tensor(np.concatenate([vertices_m, ground])), tensor(faces.astype(np.uint32))
        )
        self.cast()

    def cast(self) -> np.ndarray:
        """Return the (H, W) depth."""
        tensor = self._o3d.core.Tensor
        rays = self._scene.create_rays_pinhole(
            tensor(self._K), tensor(self._T), self._optics.width, self._optics.height
        )
        return self._scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=480)
    args = parser.parse_args()

    bend = DeformationSpec(kind="bend", amplitude=0.3, hz=0.5)
    spec = SceneSpec(object="bunny", height_m=0.4, subdivide=2, deformations=(bend,), seed=0)
    scene = Scene.from_spec(spec)
    optics = Intrinsics.from_vertical_fov(args.width, args.height, np.radians(45))
    T_world_camera = look_at((1.03, 0.0, 0.58), (0.0, 0.0, 0.2))
    T_world_target = planar(0.0, 0.0, 0.5)
    vertices = scene.vertices_world(0.3, T_world_target)
    renderer, painter = Renderer(optics, MAX_RANGE_M), Painter()
    caster = RayCaster(scene.faces, optics, T_world_camera)
    height_m = float(T_world_camera[2, 3])

    def reporter(noise: str) -> Callable[[], object]:
        sensor = DepthSensor(DepthSettings(noise=noise), seed=0, camera=0)
        return lambda: sensor.report(renderer, scene.faces, height_m, 1)

    ours = {
        "deform and place the mesh": lambda: scene.vertices_world(0.3, T_world_target),
        "true depth": lambda: renderer.draw(vertices, scene.faces, T_world_camera),
        "report: ideal": reporter("ideal"),
        "report: nguyen": reporter("nguyen"),
        "report: d4xx": reporter("d4xx"),
        "colour, JPEG": lambda: painter.jpeg(renderer, scene, vertices, T_world_camera),
    }
    theirs = {
        "Open3D, scene kept": caster.cast,
        "Open3D, scene rebuilt": lambda: caster.build(vertices),
    }
    caster.build(vertices)
    renderer.draw(vertices, scene.faces, T_world_camera)
    agreement = compare(renderer, caster.cast())
    ms = medians(ours, theirs, args.images)

    draw, image = ms["true depth"], ms["true depth"] + ms["report: nguyen"]
    pixels = int((renderer.triangle >= 0).sum())
    print(describe("numba", "numpy", "open3d"))
    print(
        f"{args.width}x{args.height}, {len(scene.faces)} triangles on {pixels} pixels, the ground"
    )
    print(f"on the rest; median of {args.images}; {agreement}")
    print()
    kept, rebuilt = ms["Open3D, scene kept"], ms["Open3D, scene rebuilt"]
    print(f"true depth      {kept / draw:5.1f} x as fast as Open3D on a rigid body")
    print(f"                {rebuilt / draw:5.1f} x on a deforming one (scene rebuilt per tick)")
    print(f"with the noise  {kept / image:5.1f} x and {rebuilt / image:.1f} x (theirs has none)")
    print()
    for name, value in ms.items():
        print(f"{name:28s} {value:7.2f} ms")
    print(f"{'depth image (nguyen), total':28s} {image:7.2f} ms")


def medians(
    ours: dict[str, Callable[[], object]], theirs: dict[str, Callable[[], object]], images: int
) -> dict[str, float]:
    """Return the median milliseconds of each call."""
    calls = ours | theirs
    seen: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(WARM_UP):
        for call in calls.values():
            call()
    for k in range(images):
        for name, call in calls.items():
            if name in ours or k % OURS_PER_THEIRS == 0:
                began_s = time.perf_counter()
                call()
                seen[name].append(time.perf_counter() - began_s)
    return {name: float(np.median(times)) * 1e3 for name, times in seen.items()}


def compare(drawn: Renderer, truth: np.ndarray) -> str:
    """Say how far the two images are apart on the body."""
    body = (drawn.triangle >= 0) & np.isfinite(truth)
    apart_mm = np.abs(drawn.depth_m[body] - truth[body]).max() * 1e3
    return f"body's depths at most {apart_mm:.3f} mm apart"


if __name__ == "__main__":
    main()
