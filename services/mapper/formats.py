"""Maps on disk: which file name means which format."""

from pathlib import Path

from services.mapper import npz_file, octree_file, ply_file, safe_file, surface_mesh
from services.mapper.errors import BadMapFile, MapperError
from services.mapper.stored_map import StoredMap

_MESHES = (".ply", ".obj", ".glb")
WRITTEN = (".npz", ".ply", ".bt", ".ot", ".obj", ".glb")
_READ = (".npz", ".ply", ".bt", ".ot")


def write(stored: StoredMap, path: str | Path, mesh: bool = False) -> None:
    """Write a map; the file is there whole or not at all.

    Args:
        stored: the map.
        path: `.npz` everything known, `.bt` and `.ot` OctoMap's octree (classes; log-odds and
            color), `.ply` occupied voxels as points, `.obj` and `.glb` the surface.
        mesh: write the surface to `.ply`, too.

    Raises:
        BadMapFile: If the name ends otherwise or the file cannot be written.
        MapTooLarge: If the format cannot hold the map.
    """
    path = Path(path)
    check_written(path, mesh)
    try:
        safe_file.replace(path, _bytes(stored, path.suffix, mesh))
    except MapperError as error:
        raise type(error)(f"cannot write {path}: {error}") from error
    except OSError as error:
        raise BadMapFile(f"cannot write {path}: {error.strerror or error}") from error


def check_written(path: Path, mesh: bool = False) -> None:
    """See to it, before there is anything to write, that a name tells a format.

    Raises:
        BadMapFile: Naming the choices.
    """
    known = _MESHES if mesh else WRITTEN
    if path.suffix not in known:
        what = "mesh format" if mesh else "format"
        raise BadMapFile(f"unknown {what} {path.suffix!r} of {path}; known: {', '.join(known)}")


def check_read(path: Path) -> None:
    """See to it that a name tells a format that can be read.

    Raises:
        BadMapFile: Naming the choices.
    """
    if path.suffix in _MESHES and path.suffix not in _READ:
        raise BadMapFile(f"{path} is a surface, not a map; known: {', '.join(_READ)}")
    if path.suffix not in _READ:
        raise BadMapFile(f"unknown format {path.suffix!r} of {path}; known: {', '.join(_READ)}")


def read(path: str | Path, voxel_m: float | None = None) -> StoredMap:
    """Read a map.

    Args:
        path: `.npz`, `.bt`, `.ot`, or `.ply` of points.
        voxel_m: edge of a voxel, m, for points that do not tell it.

    Raises:
        BadMapFile: If the name ends otherwise, or the file cannot be read or is damaged.
        BadBox, MapTooLarge, BadSensorModel: If no map of ours can hold it.
    """
    path = Path(path)
    check_read(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadMapFile(f"cannot read {path}: {error.strerror or error}") from error
    try:
        match path.suffix:
            case ".npz":
                return npz_file.read_npz(data)
            case ".bt":
                return octree_file.read_bt(data)
            case ".ot":
                return octree_file.read_ot(data)
            case _:
                return ply_file.read_ply(data, voxel_m)
    except MapperError as error:
        raise type(error)(f"cannot read {path}: {error}") from error


def _bytes(stored: StoredMap, suffix: str, mesh: bool) -> bytes:
    match suffix:
        case ".npz":
            return npz_file.npz_bytes(stored)
        case ".bt":
            return octree_file.bt_bytes(stored)
        case ".ot":
            return octree_file.ot_bytes(stored)
        case ".ply" if not mesh:
            return ply_file.ply_bytes(stored)
        case _:
            return surface_mesh.mesh_bytes(stored, suffix.removeprefix("."))
