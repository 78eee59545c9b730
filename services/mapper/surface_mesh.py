"""The surface of a map as triangles: `.ply`, `.obj`, `.glb`.

Marching cubes (Lewiner et al., 2003, by scikit-image) on a smoothed field finds the surface's
shape; moving its vertices onto the plane through the occupied voxels nearby (moving least squares:
Levin, 2003) finds its place to a tenth of a voxel; smoothing that does not shrink (Taubin, 1995, by
trimesh) takes away the terraces that voxels leave.
"""

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels import nearby
from services.kernels.bricks import BRICK, UNKNOWN
from services.mapper.errors import BadMapFile, MapTooLarge
from services.mapper.stored_map import UNCOLORED, StoredMap, occupied

FloatArray = NDArray[np.float64]

_FREE, _OCCUPIED, _UNKNOWN = -1.0, 0.4, 1.0
"""The field. Occupied is nearer to free than what lies behind: zero is within occupied voxels."""
_SMOOTH = 0.7
"""Standard deviation, voxels. With the field's values the best of a grid search on the bunny."""
_REACH = 1.75
"""What is within so many voxels of a vertex tells its plane and its color."""
_STEPS = 2
_TERRACES = 10
"""Steps of smoothing: more lose thin parts, fewer show terraces."""
_MAX_CELLS = 1 << 27
"""Half a gibibyte of field."""


class Mesh(NamedTuple):
    """Triangles, counter-clockwise seen from free space."""

    vertices_m: FloatArray
    """(V, 3), map frame."""
    faces: NDArray[np.int64]
    """(F, 3)"""
    color: NDArray[np.uint8] | None
    """(V, 3)"""


def surface(stored: StoredMap) -> Mesh:
    """Return the surface between free and occupied space; where nothing was seen it is open.

    Raises:
        BadMapFile: If no occupied voxel faces free space, or scikit-image is not installed.
        MapTooLarge: If the occupied voxels spread over too much space.
    """
    voxels = occupied(stored)
    field, corner = _field(stored)
    centres = voxels.voxel - corner
    _keep_thin(field, centres)
    vertices, faces = _isosurface(field)
    number = np.full(field.shape, -1, np.int32)
    number[tuple(centres.T)] = np.arange(len(centres))
    vertices, faces = _beside(vertices, faces, number)
    for _ in range(_STEPS):
        vertices = _onto_planes(vertices, number)
    vertices = _smoothed(vertices, faces)
    color = None
    if voxels.color is not None:
        color = np.empty(vertices.shape, np.uint8)
        nearby.near_colors(vertices, number, _REACH, voxels.color, UNCOLORED, color)
    box = stored.box
    vertices_m = (vertices + corner + box.first_key + 0.5) * box.resolution_m
    return Mesh(vertices_m, faces, color)


def mesh_bytes(stored: StoredMap, kind: str) -> bytes:
    """Return the surface as a file: `ply`, `obj` or `glb`, with normals.

    Raises:
        BadMapFile, MapTooLarge: As `surface` does.
    """
    vertices, faces, color = surface(stored)
    mesh = _trimesh().Trimesh(vertices, faces, vertex_colors=color, process=False)
    kwargs: dict[str, Any] = {"vertex_normal": True} if kind == "ply" else {"include_normals": True}
    data = mesh.export(file_type=kind, **kwargs)
    return data.encode() if isinstance(data, str) else bytes(data)


def _trimesh() -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise _missing(error) from error
    return trimesh


def _missing(error: ImportError) -> BadMapFile:
    return BadMapFile(f"a mesh needs {error.name}: pip install 'encircle[mesh]'")


def _field(stored: StoredMap) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the smoothed field of the occupied bricks and their neighbours, and its corner."""
    try:
        from scipy.ndimage import gaussian_filter
    except ImportError as error:
        raise _missing(error) from error
    holding = stored.bricks[(stored.log_odds >= 0).any(axis=1)].astype(np.int64)
    if len(holding) == 0:
        raise BadMapFile("the map has no occupied voxel, so it has no surface")
    low, high = holding.min(axis=0) - 1, holding.max(axis=0) + 2
    cells = int(np.prod((high - low) * BRICK))
    if cells > _MAX_CELLS:
        raise MapTooLarge(
            f"occupied voxels lie in {(high - low) * BRICK} voxels, {cells:.3g} in all; "
            f"at most {_MAX_CELLS:.3g} are meshed at once"
        )
    inside = ((stored.bricks >= low) & (stored.bricks < high)).all(axis=1)
    log_odds = stored.log_odds[inside]
    told = np.full(log_odds.shape, _FREE, np.float32)
    told[log_odds >= 0] = _OCCUPIED
    told[log_odds == UNKNOWN] = _UNKNOWN
    blocks = np.full((*(high - low), BRICK, BRICK, BRICK), _UNKNOWN, np.float32)
    blocks[tuple((stored.bricks[inside] - low).T)] = told.reshape(-1, BRICK, BRICK, BRICK)
    sharp = blocks.transpose(0, 3, 1, 4, 2, 5).reshape(*(high - low) * BRICK)
    return gaussian_filter(sharp, _SMOOTH), low * BRICK


def _keep_thin(field: NDArray[np.float32], centres: NDArray[np.int64]) -> None:
    """Put back occupied voxels (N, 3) near which smoothing has left none, as if all were free."""
    lost = centres[field[tuple(centres.T)] < 0.0]
    for off in product((-1, 0, 1), repeat=3):
        lost = lost[field[tuple((lost + off).T)] < 0.0]
    field[tuple(lost.T)] = _OCCUPIED


def _isosurface(field: NDArray[np.float32]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return vertices (V, 3), voxels, and faces (F, 3) of the zero of a field."""
    try:
        from skimage import measure
    except ImportError as error:
        raise _missing(error) from error
    if not field.min() < 0.0 < field.max():
        raise BadMapFile("no occupied voxel faces free space, so there is no surface")
    cubes: Any = measure.marching_cubes
    vertices, faces, _, _ = cubes(field, 0.0, gradient_direction="ascent")
    return vertices.astype(np.float64), faces.astype(np.int64)


def _beside(
    vertices: FloatArray, faces: NDArray[np.int64], number: NDArray[np.int32]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Keep the faces beside occupied voxels: the others part free from never seen."""
    count, _, _ = _moments(vertices, number)
    faces = faces[(count > 0)[faces].all(axis=1)]
    if len(faces) == 0:
        raise BadMapFile("no occupied voxel faces free space, so there is no surface")
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)


def _onto_planes(vertices: FloatArray, number: NDArray[np.int32]) -> FloatArray:
    """Move vertices (V, 3) along the normal of the plane through what is near them."""
    count, mean, second = _moments(vertices, number)
    _, axes = np.linalg.eigh(second)
    normal = axes[:, :, 0]
    step = (mean * normal).sum(axis=1).clip(-1.0, 1.0)
    step[count < 4] = 0.0  # three always have a plane.
    moved: FloatArray = vertices + step[:, None] * normal
    return moved


def _moments(
    vertices: FloatArray, number: NDArray[np.int32]
) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
    """Return count, mean and covariance of what is near; see `near_moments`."""
    rows = len(vertices)
    count, mean, second = np.empty(rows, np.int32), np.empty((rows, 3)), np.empty((rows, 3, 3))
    nearby.near_moments(vertices, number, _REACH, count, mean, second)
    return count, mean, second


def _smoothed(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    trimesh = _trimesh()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    trimesh.smoothing.filter_taubin(mesh, lamb=0.5, nu=0.53, iterations=_TERRACES)
    return np.array(mesh.vertices, np.float64)
