"""Mesh files: .obj, .ply, .stl and .off, read through trimesh and checked."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.world.errors import MeshError
from services.world.shapes import NAMES

SUFFIXES = (".obj", ".ply", ".stl", ".off")
MAX_FILE_BYTES = 256 * 1024**2  # A 2 M triangle ASCII .obj; larger would stall every process.
MAX_FACES = 2_000_000


def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the triangles of a file, equal vertices merged, triangles without area removed.

    Returns:
        (V, 3) vertices in the file's own units and axes, (F, 3) faces.

    Raises:
        MeshError: If the file is missing, of another kind, unreadable, too large, empty, holds a
            coordinate that is not finite, or nothing that encloses space.
    """
    _check_file(path)
    vertices, faces = _parse(path)
    if len(faces) == 0 or len(vertices) == 0:
        raise MeshError(f"{path}: holds no triangles")
    if len(faces) > MAX_FACES:
        raise MeshError(f"{path}: {len(faces)} triangles, at most {MAX_FACES} are taken")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(f"{path}: a triangle names a vertex outside 0..{len(vertices) - 1}")
    if not np.isfinite(vertices[faces]).all():
        raise MeshError(f"{path}: a vertex is not finite")
    vertices, faces = _clean(vertices, faces)
    if len(faces) < 4:  # A tetrahedron is the smallest solid.
        raise MeshError(f"{path}: {len(faces)} triangles with an area; a solid has at least 4")
    return vertices, faces


def _check_file(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(
            f"no object {str(path)!r}; known: {', '.join(NAMES)}, or a file {', '.join(SUFFIXES)}"
        )
    if not path.is_file():
        raise MeshError(f"no file {str(path)!r}; built in: {', '.join(NAMES)}")
    size = path.stat().st_size
    if size == 0:
        raise MeshError(f"{path}: the file is empty")
    if size > MAX_FILE_BYTES:
        raise MeshError(f"{path}: {size} bytes, at most {MAX_FILE_BYTES} are read")


def _parse(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    import trimesh  # 0.4 s, and only for files.

    try:
        mesh: Any = trimesh.load(str(path), force="mesh", process=False)
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # A foreign parser may raise anything on garbage.
        raise MeshError(
            f"{path}: not a readable {path.suffix} mesh ({type(error).__name__}: {error})"
        ) from error
    for name, rows in (("corners", vertices), ("triangles", faces)):
        if len(rows) and rows.shape[1:] != (3,):  # The parser takes as many as a line has.
            raise MeshError(f"{path}: its {name} are of shape {rows.shape}; it must be (N, 3)")
    return vertices, faces


def _clean(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    used = np.unique(faces)
    extent = float(np.ptp(vertices[used], axis=0).max())
    if extent > 0.0:
        # STL repeats each corner per triangle, rounded to float32.
        grid = np.round((vertices[used] - vertices[used].min(axis=0)) / (extent * 1e-7))
        _, first, renumbered = np.unique(grid, axis=0, return_index=True, return_inverse=True)
        lookup = np.zeros(len(vertices), np.int64)
        lookup[used] = renumbered.reshape(-1)
        vertices, faces = vertices[used][first], lookup[faces]
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return vertices, faces[distinct & (area > 0.0)]
