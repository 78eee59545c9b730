"""Named scenes that mappers are measured and compared on: six views each, seeded."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.mapping_scene import (
    NO_RETURN,
    TOYS,
    FloatArray,
    Pinhole,
    Solids,
    camera_pose,
    cast,
    measured,
    points,
    rays,
)
from services.mapper.view import View

VFOV_RAD = math.radians(45)
MAX_RANGE_M = 10.0
Corner = tuple[float, float, float]
Box = tuple[Corner, Corner]
ROOM: Box = ((-1.28, -1.28, -0.16), (1.28, 1.28, 1.12))
"""Holds all that cameras on the ring see: OctoMap's whole map and ours are the same region."""
JOB: Box = ((-0.6, -0.6, -0.1), (0.6, 0.6, 0.7))
"""The box of the main job: the cameras are outside."""


@dataclass(frozen=True)
class Scene:
    """Images of one scene and the box to map; where nothing returns, pixels are invalid (0)."""

    views: list[View]
    box: Box

    def clouds(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return the points (N, 3) and the eye (3,) of every view, world frame, m."""
        return [cloud(view) for view in self.views]

    def write(self, path: Path) -> None:
        """Write to an .npz file."""
        first = self.views[0]
        np.savez(
            path,
            depth=np.stack([view.depth for view in self.views]),
            T=np.stack([view.T_map_camera for view in self.views]),
            pinhole=first.pinhole,
            scale_and_range_m=(first.scale_m, first.max_range_m),
            box=self.box,
        )

    @classmethod
    def read(cls, path: Path) -> "Scene":
        """Read what `write` wrote."""
        with np.load(path) as f:
            depth, T, (low, high) = f["depth"], f["T"], f["box"].tolist()
            fx, fy, cx, cy = f["pinhole"].tolist()
            scale_m, range_m = f["scale_and_range_m"].tolist()
        pinhole = (fx, fy, cx, cy)
        views = [View(d, pinhole, t, scale_m, range_m) for d, t in zip(depth, T, strict=True)]
        return cls(views, (tuple(low), tuple(high)))


def cloud(view: View) -> tuple[FloatArray, FloatArray]:
    """Return a view's returns (N, 3) and eye (3,), world frame, m; no return: the maximum range."""
    image = view.depth
    if view.max_range_m < MAX_RANGE_M:
        image = np.where(image == NO_RETURN, round(view.max_range_m / view.scale_m), image)
    return points(image, view.pinhole, view.T_map_camera), view.T_map_camera[:3, 3].copy()


def pinhole_of(size: tuple[int, int]) -> Pinhole:
    """Return the intrinsics of a (width, height) image of 45 degrees, upright."""
    width, height = size
    focal_px = height / 2 / math.tan(VFOV_RAD / 2)
    return focal_px, focal_px, (width - 1) / 2, (height - 1) / 2


def ring(
    num: int = 6, radius_m: float = 1.03, height_m: float = 0.58, aim_m: float = 0.2
) -> list[FloatArray]:
    """Return the poses of cameras around the origin."""
    return [
        camera_pose(0.13 + k * 2 * math.pi / num, radius_m, height_m, aim_m) for k in range(num)
    ]


def photographed(
    size: tuple[int, int],
    solids: Solids,
    poses: list[FloatArray],
    spoil: Callable[[FloatArray, np.random.Generator], FloatArray] | None = None,
    empty: int = 0,
    max_range_m: float = MAX_RANGE_M,
) -> list[View]:
    """Return a view of solids from every pose; `spoil` changes true depths (H, W), m."""
    rng, pinhole, views = np.random.default_rng(0), pinhole_of(size), []
    for T in poses:
        depth = cast(rays((size[1], size[0]), pinhole, T), T[:3, 3], solids)
        image = measured(depth if spoil is None else spoil(depth, rng), rng, empty)
        views.append(View(image, pinhole, T, 0.001, max_range_m))
    return views


def toys(size: tuple[int, int], empty: int = 0) -> Scene:
    """Spheres and boxes on a plate, in a room that holds all that is seen."""
    return Scene(photographed(size, TOYS, ring(), empty=empty), ROOM)


def toys_in_job(size: tuple[int, int]) -> Scene:
    """Spheres and boxes in the main job's box: sensors outside, rays leave through all faces."""
    return Scene(photographed(size, TOYS, ring()), JOB)


def floor(size: tuple[int, int]) -> Scene:
    """Spheres and boxes on a floor of 6 x 6 m: what cameras see of a hall."""
    solids = replace(TOYS, plate_half_m=3.0)
    return Scene(photographed(size, solids, ring()), ((-3.0, -3.0, -0.16), (3.0, 3.0, 1.12)))


def bunny(size: tuple[int, int]) -> Scene:
    """The bunny, 0.4 m high, on a plate, by the simulator's own renderer."""
    from schemas.camera import Intrinsics
    from services.camera.sources.renderer import Renderer
    from services.world.mesh import load_mesh

    mesh, rng, views = load_mesh("bunny"), np.random.default_rng(0), []
    renderer = Renderer(Intrinsics.from_vertical_fov(*size, VFOV_RAD), MAX_RANGE_M)
    fx, fy, cx, cy = (float(value) for value in renderer.intrinsics)
    for T in ring():
        renderer.draw(mesh.vertices_m, mesh.faces, T)
        depth = renderer.depth_m.astype(np.float64)
        # The renderer's ground has no end: cut it where the plate ends.
        end = T[:3, 3] + rays((size[1], size[0]), (fx, fy, cx, cy), T) * depth[..., None]
        off = (np.abs(end[..., :2]) > TOYS.plate_half_m).any(axis=-1) & (renderer.triangle < 0)
        depth[off | ~np.isfinite(depth)] = np.inf
        views.append(View(measured(depth, rng, 0), (fx, fy, cx, cy), T, 0.001, MAX_RANGE_M))
    return Scene(views, ROOM)


def clutter() -> Solids:
    """A walled room of 2.4 m with a table, shelves, boxes, balls and thin legs."""
    rng = np.random.default_rng(5)
    walls = [[-1.3, -1.3, -0.1, -1.2, 1.3, 1.3], [1.2, -1.3, -0.1, 1.3, 1.3, 1.3]]
    walls += [[-1.3, -1.3, -0.1, 1.3, -1.2, 1.3], [-1.3, 1.2, -0.1, 1.3, 1.3, 1.3]]
    walls += [[-1.3, -1.3, 1.15, 1.3, 1.3, 1.3]]
    boxes, balls, legs = [*walls, [-0.4, -0.25, 0.3, 0.2, 0.25, 0.32]], [], []
    legs += [[x, y, 0.0, 0.3, 0.012] for x in (-0.38, 0.18) for y in (-0.23, 0.23)]
    for _ in range(14):
        x, y = rng.uniform(-0.75, 0.75, 2)
        a, b, c = rng.uniform(0.02, 0.12, 3)
        boxes.append([x - a, y - b, 0.0, x + a, y + b, 2 * c])
    for _ in range(5):
        x, y, r = *rng.uniform(-0.7, 0.7, 2), rng.uniform(0.04, 0.1)
        balls.append([x, y, r, r])
    for _ in range(14):
        x, y, r = *rng.uniform(-0.8, 0.8, 2), rng.uniform(0.004, 0.03)
        legs.append([x, y, 0.0, rng.uniform(0.3, 0.9), r])
    return Solids(np.array(balls), np.array(boxes), np.array(legs), plate_half_m=1.3)


def room(size: tuple[int, int]) -> Scene:
    """A cluttered room whose walls return every pixel; the cameras are inside the box."""
    return Scene(photographed(size, clutter(), ring(6, 1.05, 0.75, 0.25)), ROOM)


SCENES: dict[str, Callable[[tuple[int, int]], Scene]] = {
    "toys": toys,
    "bunny": bunny,
    "room": room,
}
"""What `mapping.py` measures."""
