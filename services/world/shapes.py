"""The built-in shapes, each a closed surface with x forward and z up, of any size."""

import importlib.util
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from services.world.errors import MeshError
from services.world.subdivision import loop, split

Triangles = tuple[NDArray[np.float64], NDArray[np.int64]]

NAMES = ("bunny", "sphere", "box", "torus")

_SPHERE_LEVELS = 4  # 20 * 4**4 = 5120 triangles.
_BOX_LEVELS = 4  # 12 * 4**4 = 3072 triangles.
_TORUS_SEGMENTS = (96, 40)  # 7680 triangles.
_TORUS_RADII = (0.7, 0.3)  # The hole is as wide as 0.8 of the height: a camera sees through it.


def build(name: str, subdivide: int) -> Triangles:
    """Build a shape of `NAMES`; `subdivide` counts the bunny's steps of Loop subdivision."""
    match name:
        case "bunny":
            return _bunny(subdivide)
        case "sphere":
            return _sphere()
        case "box":
            return _box()
        case "torus":
            return _torus()
    raise MeshError(f"no shape {name!r}; known: {', '.join(NAMES)}")


def _bunny(subdivide: int) -> Triangles:
    """Read pybullet_data's bunny (902 triangles, y up, z forward) and make it smooth."""
    # Found without importing pybullet itself, which is slow and which cameras do not need.
    spec = importlib.util.find_spec("pybullet_data")
    if spec is None or spec.origin is None:
        raise MeshError(
            "the bunny comes with pybullet: pip install 'encircle[simulator]'; "
            f"without it: {', '.join(NAMES[1:])}, or a file"
        )
    rows = [line.split() for line in Path(spec.origin).with_name("bunny.obj").open()]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], np.float64)
    corners = [[c.split("/")[0] for c in row[1:4]] for row in rows if row[:1] == ["f"]]
    faces = np.array(corners, np.int64) - 1
    for _ in range(subdivide):
        vertices, faces = loop(vertices, faces)
    return np.roll(vertices, 1, axis=1), faces


def _sphere() -> Triangles:
    g = (1 + np.sqrt(5)) / 2
    plane = np.array([[-1, g], [1, g], [-1, -g], [1, -g]])
    zero = np.zeros((4, 1))
    vertices = np.concatenate(
        [
            np.hstack([plane, zero]),
            np.hstack([zero, plane]),
            np.hstack([plane[:, 1:], zero, plane[:, :1]]),
        ]
    )
    faces = _hull(vertices)
    for _ in range(_SPHERE_LEVELS):
        vertices, faces = split(vertices, faces)
        vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return vertices, faces


def _hull(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the icosahedron's faces: the triples of mutual neighbours, wound outward."""
    distance = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = np.isclose(distance, 2.0)
    faces = []
    for a, b in np.argwhere(near):
        for c in np.flatnonzero(near[a] & near[b]):
            if a < b < c:
                inside_out = np.linalg.det(vertices[[a, b, c]]) < 0
                faces.append((a, c, b) if inside_out else (a, b, c))
    return np.array(faces, np.int64)


def _box() -> Triangles:
    vertices = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], np.float64)
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int64)
    for _ in range(_BOX_LEVELS):
        vertices, faces = split(vertices, faces)
    return vertices, faces


def _torus() -> Triangles:
    """Build a ring that stands on its rim like a wheel, its axle along y."""
    (m, n), (major, minor) = _TORUS_SEGMENTS, _TORUS_RADII
    i, j = (grid.reshape(-1) for grid in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    u, v = 2 * np.pi * i / m, 2 * np.pi * j / n
    reach = major + minor * np.cos(v)
    vertices = np.stack([reach * np.cos(u), minor * np.sin(v), reach * np.sin(u)], axis=1)
    a, b = i * n + j, (i + 1) % m * n + j
    c, d = (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    return vertices, faces
