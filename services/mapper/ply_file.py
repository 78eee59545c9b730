"""`.ply` of points: centres of occupied voxels, with probability and, if known, color."""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import BRICK, UNKNOWN, VOXELS
from services.mapper.box import Box
from services.mapper.errors import BadMapFile
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.stored_map import StoredMap, check_size, occupied

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2"}
_TYPES |= {"int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
_TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"}
_TYPES |= {"uint32": "u4", "float32": "f4", "float64": "f8"}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "<"}
_LONGEST_HEADER = 1 << 16
_COUNT = re.compile(r"[0-9]{1,18}")
_RGB = ("red", "green", "blue")
_SIZE = "encircle: voxel size in metres"


class _Header(NamedTuple):
    order: str
    num_vertices: int
    vertex: np.dtype[np.void]
    voxel_size_m: float | None
    length: int


def ply_bytes(stored: StoredMap) -> bytes:
    """Return the occupied voxels as binary little-endian vertices."""
    voxels = occupied(stored)
    fields = [(name, "<f4") for name in ("x", "y", "z", "probability")]
    fields += [] if voxels.color is None else [(name, "u1") for name in _RGB]
    vertices = np.empty(len(voxels.voxel), fields)
    vertices["x"], vertices["y"], vertices["z"] = stored.box.centres_m(voxels.voxel).T
    vertices["probability"] = 1.0 / (1.0 + np.exp(-voxels.log_odds / LOG_ODDS_SCALE))
    if voxels.color is not None:
        for name, channel in zip(_RGB, voxels.color.T, strict=True):
            vertices[name] = channel
    return vertex_bytes(
        vertices,
        "encircle: centres of occupied voxels, metres",
        f"{_SIZE} {stored.box.resolution_m!r}",
    )


def vertex_bytes(vertices: NDArray[np.void], *comments: str) -> bytes:
    """Return (N,) vertices, fields of little-endian float32 and uint8, as binary PLY."""
    kinds = {"<f4": "float", "|u1": "uchar"}
    names = vertices.dtype.names or ()
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {comment}" for comment in comments),
        f"element vertex {len(vertices)}",
        *(f"property {kinds[vertices.dtype[name].str]} {name}" for name in names),
        "end_header",
    ]
    return "\n".join([*header, ""]).encode() + vertices.tobytes()


def read_ply(data: bytes, voxel_m: float | None = None) -> StoredMap:
    """Read points, ours or anybody's; a voxel that holds one is what its best point says.

    Points that are not finite are skipped; one without probability counts as one hit.

    Args:
        data: ascii or binary PLY whose first element is `vertex`.
        voxel_m: edge of a voxel, m; needed if the file does not tell, stronger if it does.

    Raises:
        BadMapFile: If the data are no such file, or nobody tells the size of a voxel.
        BadBox, MapTooLarge: If the points need an impossible box.
    """
    header = _parsed(data)
    size_m = voxel_m or header.voxel_size_m
    if size_m is None:
        raise BadMapFile("it tells no voxel size; give one (--voxel METRES)")
    vertices = _vertices(header, data)
    with np.errstate(invalid="ignore"):  # not a number, and not quietly.
        points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1)
    finite = np.isfinite(points).all(axis=1)
    points, vertices = points[finite], vertices[finite]
    sensor = SensorModel()
    names = vertices.dtype.names or ()
    hit = np.full(len(points), sensor.hit)
    log_odds = _fixed_point(vertices["probability"] if "probability" in names else hit)
    if len(points):
        # The box's voxels are those that `keys` finds, to the last rounding.
        with np.errstate(all="ignore"):  # The box refuses a size that is none.
            per_m = np.divide(1.0, size_m)
            low = np.floor(points.min(axis=0) * per_m) * size_m
            high = (np.floor(points.max(axis=0) * per_m) + 1.0) * size_m
    else:
        low, high = np.zeros(3), np.full(3, size_m)
    box = Box.covering(size_m, low, high)
    keys = box.keys(points)
    place = np.ravel_multi_index(tuple((keys // BRICK).T), box.num_bricks)
    places, rows = np.unique(place, return_inverse=True)
    check_size(len(places), 5)
    inside = keys % BRICK @ (BRICK * BRICK, BRICK, 1)
    known = np.full((len(places), VOXELS), UNKNOWN, np.int16)
    np.maximum.at(known, (rows, inside), log_odds)
    color = None
    if set(_RGB) <= set(names):
        color = np.full((len(places), VOXELS, 3), 255, np.uint8)
        color[rows, inside] = np.stack([vertices[name] for name in _RGB], axis=1)
    bricks = np.stack(np.unravel_index(places, box.num_bricks), axis=1).astype(np.int16)
    return StoredMap(box, sensor, bricks, known, color)


def _fixed_point(probability: NDArray[np.floating]) -> NDArray[np.int16]:
    with np.errstate(invalid="ignore"):  # not a number, and not quietly.
        p = probability.astype(np.float64)
    if not ((p >= 0.0) & (p <= 1.0)).all():
        raise BadMapFile("a vertex's probability is not within 0 .. 1")
    highest = np.iinfo(np.int16).max
    with np.errstate(divide="ignore"):
        fixed = np.rint(np.log(p / (1.0 - p)) * LOG_ODDS_SCALE)
    log_odds: NDArray[np.int16] = fixed.clip(-highest, highest).astype(np.int16)
    return log_odds


def _parsed(data: bytes) -> _Header:
    end = re.search(rb"\bend_header\r?\n", data[:_LONGEST_HEADER])
    if end is None or not data.startswith(b"ply"):
        raise BadMapFile(f"it begins {data[:16]!r}; a PLY begins 'ply' and tells 'end_header'")
    order, count, size_m, fields, elements = "", 0, None, [], 0
    for line in data[: end.start()].decode("latin-1").splitlines():
        match line.split():
            case ["format", name, _]:
                order = name
            case ["comment", *_] if _SIZE in line:
                size_m = _positive(line.partition(_SIZE)[2])
            case ["element", name, number]:
                elements += 1
                if elements == 1 and (name != "vertex" or not _COUNT.fullmatch(number)):
                    told = f"{name!r:.40} {number:.40}"
                    raise BadMapFile(f"its first element is {told}; it must be vertex")
                count = int(number) if elements == 1 else count
            case ["property", kind, name] if elements == 1 and kind in _TYPES:
                fields.append((name, _ORDERS.get(order, "<") + _TYPES[kind]))
            case ["property", *rest] if elements == 1:
                raise BadMapFile(f"a vertex has {' '.join(rest)!r}; known: {', '.join(_TYPES)}")
    names = [name for name, _ in fields]
    if order not in _ORDERS or not {"x", "y", "z"} <= set(names) or len(set(names)) < len(names):
        raise BadMapFile(f"format {order!r} with {names}; known: {', '.join(_ORDERS)} with x, y, z")
    return _Header(order, count, np.dtype(fields), size_m, end.end())


def _positive(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise BadMapFile(f"its voxel size {text.strip()!r} is no number") from error


def _vertices(header: _Header, data: bytes) -> NDArray[np.void]:
    """Return (N,) vertices with the fields that the header names."""
    names = header.vertex.names or ()
    body = memoryview(data)[header.length :]
    there = len(body) // header.vertex.itemsize
    if header.order == "ascii":
        words = bytes(body).split()
        there = len(words) // len(names)
    if there < header.num_vertices:
        raise BadMapFile(f"{there} vertices; the header says {header.num_vertices}")
    if header.order != "ascii":
        return np.frombuffer(body, header.vertex, header.num_vertices)
    vertices = np.empty(header.num_vertices, header.vertex)
    try:
        table = np.array(words[: header.num_vertices * len(names)], np.float64)
    except ValueError as error:
        raise BadMapFile(f"a vertex is no number: {error}") from error
    for name, column in zip(names, table.reshape(-1, len(names)).T, strict=True):
        vertices[name] = column
    return vertices
