"""Scenes that are hard on sampled free space: holes, mixed pixels, grazing planes, thin legs."""

import math
from collections.abc import Callable

import numpy as np

from benchmarks.mapping_scene import NO_RETURN, TOYS, FloatArray, Solids
from benchmarks.mapping_scenes import (
    ROOM,
    Scene,
    bunny,
    clutter,
    photographed,
    ring,
    room,
    toys,
    toys_in_job,
)
from services.kernels.rigid import look_at

JUMP_M = 0.03
"""Neighbouring depths farther apart than this are a silhouette."""
SKY_RANGE_M = 3.5
"""Beyond the far side of every box: a ray that returns nothing ends outside."""


def blotted(depth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the image with elliptic holes of 2 to 5 % of its width over about a tenth of it."""
    height, width = depth.shape
    v, u = np.mgrid[:height, :width]
    out = depth.copy()
    for _ in range(40):
        a, b = rng.uniform(0.01, 0.05, 2) * width
        inside = ((u - rng.uniform(0, width)) / a) ** 2 + ((v - rng.uniform(0, height)) / b) ** 2
        out[inside < 1] = np.nan
    return out


def rolled(depth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the image with silhouettes that waver by a pixel and mix fore- and background."""
    height, width = depth.shape
    v, u = np.mgrid[:height, :width]
    dv, du = np.rint(rng.normal(scale=0.7, size=(2, height, width))).astype(int)
    out = depth[np.clip(v + dv, 0, height - 1), np.clip(u + du, 0, width - 1)]
    padded = np.pad(np.where(np.isfinite(out), out, 1e3), 1, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    near, far = around.min(axis=(2, 3)), around.max(axis=(2, 3))
    mixed = (far - near > JUMP_M) & (far < 1e3) & (rng.random(depth.shape) < 0.4)
    share = rng.random(depth.shape)
    return np.where(mixed, share * near + (1 - share) * far, out)


def holes(size: tuple[int, int]) -> Scene:
    """Clustered holes."""
    return Scene(photographed(size, TOYS, ring(), blotted), ROOM)


def edges(size: tuple[int, int]) -> Scene:
    """Silhouettes with mixed pixels: returns that float between fore- and background."""
    return Scene(photographed(size, clutter(), ring(6, 1.05, 0.75, 0.25), rolled), ROOM)


def grazing(size: tuple[int, int]) -> Scene:
    """Cameras 6 to 16 cm above the plate, looking along it: planes at 3 to 9 degrees."""
    poses = [pose for n, pose in enumerate(ring(6, 1.03, 0.06, 0.03)) if n % 2]
    poses += [pose for n, pose in enumerate(ring(6, 1.03, 0.16, 0.05)) if not n % 2]
    return Scene(photographed(size, TOYS, poses), ROOM)


def thin(size: tuple[int, int]) -> Scene:
    """Upright legs and lying bars of 0.5 to 2 voxels of 1 cm."""
    rng = np.random.default_rng(7)
    legs, bars = [], []
    for n in range(24):
        x, y = rng.uniform(-0.5, 0.5, 2)
        legs.append([x, y, 0.0, rng.uniform(0.2, 0.6), (0.5 + 1.5 * n / 23) * 0.005])
    for n in range(8):
        x, y, z = *rng.uniform(-0.4, 0.1, 2), rng.uniform(0.1, 0.5)
        edge = (0.5 + 1.5 * n / 7) * 0.01
        long, other = (0.4, edge) if n % 2 else (edge, 0.4)
        bars.append([x, y, z, x + long, y + other, z + edge])
    return Scene(
        photographed(size, Solids(TOYS.spheres[2:], np.array(bars), np.array(legs)), ring()), ROOM
    )


def sky(size: tuple[int, int]) -> Scene:
    """Pixels without return: they carve to the maximum range."""
    views = photographed(size, TOYS, ring(), blotted, NO_RETURN, SKY_RANGE_M)
    return Scene(views, ROOM)


def outward(size: tuple[int, int]) -> Scene:
    """Cameras in the middle of the room that look at its walls, near things before them."""
    angles = 0.13 + np.arange(6) * math.pi / 3
    eyes = [(0.1 * math.cos(a), 0.1 * math.sin(a), 0.65) for a in angles]
    poses = [
        look_at(eye, (math.cos(a), math.sin(a), 0.45)) for eye, a in zip(eyes, angles, strict=True)
    ]
    return Scene(photographed(size, clutter(), poses), ROOM)


TRIALS: dict[str, Callable[[tuple[int, int]], Scene]] = {
    "toys": toys,
    "toys in the job's box": toys_in_job,
    "bunny": bunny,
    "room": room,
    "clustered holes": holes,
    "rolling edges": edges,
    "grazing planes": grazing,
    "thin things": thin,
    "no return": sky,
    "outward": outward,
}
"""What `mapping_agreement.py` compares."""
