"""The target's rest shape: a triangle mesh that stands on the ground.

Whatever the source, a mesh comes out in the target frame: metres, z up, x forward, its bounding
box centred over the origin, its lowest point on z = 0, every triangle counter-clockwise seen
from outside.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from services.world import mesh_file, shapes
from services.world.errors import MeshError
from services.world.subdivision import split
from services.world.winding import outward

# Files are split in four only up to here: beyond, the eye and the map gain nothing.
SPLIT_LIMIT_FACES = 20_000
MAX_SUBDIVIDE = 4  # 902 * 4**4 = 230 k triangles.

# Scans and artwork are stored y up, CAD parts z up.
_UP_OF_SUFFIX = {".obj": "y", ".ply": "y", ".stl": "z", ".off": "z"}
_ROLL_OF_UP = {"x": 2, "y": 1, "z": 0}


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in the target frame."""

    vertices_m: NDArray[np.float32]
    """(V, 3) metres."""
    faces: NDArray[np.int32]
    """(F, 3) indices into the vertices, counter-clockwise seen from outside."""

    @property
    def height_m(self) -> float:
        return float(self.vertices_m[:, 2].max())


def load_mesh(name_or_path: str, height_m: float = 0.4, subdivide: int = 2) -> Mesh:
    """Load a built-in shape or a mesh file and stand it on the ground.

    Args:
        name_or_path: `bunny`, `sphere`, `box`, `torus`, or a .obj, .ply, .stl or .off file. A
            file may say which of its axes is up, as in `part.stl:y`; else y is for .obj and
            .ply, z for .stl and .off. Of y up, z is taken as forward; of z up, x; of x up, y.
        height_m: height of the result.
        subdivide: how often triangles are split in four: smoothly (Loop) for the bunny, in their
            plane for files and only up to 20 000 triangles. The other shapes are fine already.

    Raises:
        MeshError: If there is no such shape or file, or the file holds no usable solid.
    """
    if not (math.isfinite(height_m) and height_m > 0.0):
        raise MeshError(f"height_m must be positive, got {height_m}")
    if not 0 <= subdivide <= MAX_SUBDIVIDE:
        raise MeshError(f"subdivide must be 0..{MAX_SUBDIVIDE}, got {subdivide}")
    if name_or_path in shapes.NAMES:
        vertices, faces = shapes.build(name_or_path, subdivide)
    else:
        vertices, faces = _from_file(name_or_path, subdivide)
    return Mesh(_standing(vertices, height_m, name_or_path), faces.astype(np.int32))


def _from_file(name: str, subdivide: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    stem, _, axis = name.rpartition(":")
    path, up = (Path(stem), axis) if stem and axis in _ROLL_OF_UP else (Path(name), "")
    if str(path) in shapes.NAMES:
        raise MeshError(f"{path} stands upright already; an up axis ({up}) is for files")
    vertices, faces = mesh_file.read(path)
    faces = outward(vertices, faces)
    for _ in range(subdivide):
        if 4 * len(faces) > SPLIT_LIMIT_FACES:
            break
        vertices, faces = split(vertices, faces)
    # Cyclic exchanges are rotations: the winding stays outward.
    return np.roll(vertices, _ROLL_OF_UP[up or _UP_OF_SUFFIX[path.suffix.lower()]], axis=1), faces


def _standing(vertices: NDArray[np.float64], height_m: float, name: str) -> NDArray[np.float32]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if not high[2] - low[2] > 1e-6 * float(np.max(high - low)):
        raise MeshError(f"{name}: has no height along its up axis; name another, as in part.stl:y")
    feet = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    standing: NDArray[np.float32]
    standing = ((vertices - feet) * (height_m / (high[2] - low[2]))).astype(np.float32)
    return standing
