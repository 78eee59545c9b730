"""OctoMap's files, byte for byte: `.bt`, a class per leaf, and `.ot`, log-odds per node.

Source of the formats: OctoMap 1.10 (Hornung et al., Autonomous Robots 34, 2013).
"""

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.kernels import linear_octree
from services.kernels.linear_octree import FREE, OCCUPIED, TOO_DEEP
from services.mapper.errors import BadMapFile
from services.mapper.octree import Leaves, leaves_of, stored_from
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.stored_map import UNCOLORED, StoredMap

_BINARY, _FULL = "# Octomap OcTree binary file", "# Octomap OcTree file"
_COMMENT = "# (feel free to add / change comments, but leave the first line as it is!)\n#"
_LONGEST_HEADER = 1 << 16
_PLAIN = np.dtype([("log_odds", "<f4"), ("children", "u1")])
_COLORED = np.dtype([("log_odds", "<f4"), ("color", "u1", 3), ("children", "u1")])
_RECORDS = {"OcTree": _PLAIN, "ColorOcTree": _COLORED, "OcTreeStamped": _PLAIN}
"""Bytes per node of a `.ot`, by the kind of tree; OctoMap does not write the stamps."""


class _Header(NamedTuple):
    kind: str
    num_nodes: int
    resolution_m: float


def bt_bytes(stored: StoredMap) -> bytes:
    """Return the `.bt` of a map: free, occupied (log-odds >= 0) or unknown, pruned.

    Raises:
        MapTooLarge: If the map does not fit OctoMap's 65536 voxels per axis.
    """
    leaves = leaves_of(stored, classes_only=True)
    _, _, word = _nodes(leaves)
    header = _header(_BINARY, _Header("OcTree", len(word), stored.box.resolution_m))
    words: bytes = word[word != 0].astype("<u2").tobytes()
    return header + words


def ot_bytes(stored: StoredMap) -> bytes:
    """Return the `.ot` of a map, pruned where log-odds and color are equal; inner nodes as OctoMap.

    Raises:
        MapTooLarge: If the map does not fit OctoMap's 65536 voxels per axis.
    """
    leaves = leaves_of(stored)
    leaf, parent, word = _nodes(leaves)
    record = _PLAIN if leaves.color is None else _COLORED
    nodes = np.empty(len(word), record)
    is_leaf = leaf >= 0
    value = np.full(len(word), np.iinfo(np.int16).min, np.int16)
    value[is_leaf] = leaves.log_odds
    linear_octree.raise_largest(value, parent)
    nodes["log_odds"] = value / np.float32(LOG_ODDS_SCALE)
    nodes["children"] = _children(word)
    if leaves.color is not None:
        color = np.empty((len(word), 3), np.uint8)
        color[is_leaf] = leaves.color
        linear_octree.raise_colors(color, leaf, parent, UNCOLORED)
        nodes["color"] = color
    kind = "OcTree" if leaves.color is None else "ColorOcTree"
    header = _header(_FULL, _Header(kind, len(word), stored.box.resolution_m))
    return header + nodes.tobytes()


def read_bt(data: bytes, sensor: SensorModel | None = None) -> StoredMap:
    """Read a `.bt`; its voxels get the sensor model's clamps, as OctoMap gives them.

    Raises:
        BadMapFile: If the data are none, cut short, too long or too deep.
        BadBox, MapTooLarge: If the known voxels need an impossible box.
    """
    sensor = sensor or SensorModel()
    header, body = _parsed(data, _BINARY)
    if len(body) % 2:
        raise BadMapFile(f"{len(body)} bytes of nodes; there must be two per inner node")
    words = np.frombuffer(body, "<u2")
    room = 8 * len(words)
    code, depth = np.empty(room, np.int64), np.empty(room, np.uint8)
    occupied = np.empty(room, np.bool_)
    count, used = linear_octree.walk_words(words, code, depth, occupied)
    _check_walk(count, used, len(words), 2)
    if count + used != header.num_nodes:
        raise BadMapFile(f"{count + used} nodes; the header says {header.num_nodes}")
    _, _, low, high = sensor.fixed_point()
    log_odds = np.where(occupied[:count], high, low).astype(np.int16)
    leaves = Leaves(code[:count], depth[:count], log_odds, None)
    return stored_from(leaves, header.resolution_m, sensor)


def read_ot(data: bytes, sensor: SensorModel | None = None) -> StoredMap:
    """Read a `.ot` of an OcTree, ColorOcTree or OcTreeStamped.

    Log-odds are rounded to 1/8192, and held within +-4: beyond are more than 55 equal answers.

    Raises:
        BadMapFile: If the data are none, cut short, too long or too deep, or log-odds not finite.
        BadBox, MapTooLarge: If the known voxels need an impossible box.
    """
    header, body = _parsed(data, _FULL)
    record = _RECORDS[header.kind]
    if len(body) != header.num_nodes * record.itemsize:
        raise BadMapFile(
            f"{len(body)} bytes of nodes; the header's {header.num_nodes} nodes of "
            f"{header.kind} take {header.num_nodes * record.itemsize}"
        )
    nodes = np.frombuffer(body, record)
    code, depth = np.empty(len(nodes), np.int64), np.empty(len(nodes), np.uint8)
    node = np.empty(len(nodes), np.int64)
    count, used = linear_octree.walk_children(
        np.ascontiguousarray(nodes["children"]), code, depth, node
    )
    _check_walk(count, used, len(nodes), record.itemsize)
    told = nodes[node[:count]]
    if not np.isfinite(told["log_odds"]).all():
        raise BadMapFile("a leaf's log-odds are not finite")
    highest = np.iinfo(np.int16).max
    fixed = np.rint(told["log_odds"].astype(np.float64) * LOG_ODDS_SCALE)
    log_odds = fixed.clip(-highest, highest).astype(np.int16)
    color = np.ascontiguousarray(told["color"]) if header.kind == "ColorOcTree" else None
    leaves = Leaves(code[:count], depth[:count], log_odds, color)
    return stored_from(leaves, header.resolution_m, sensor or SensorModel())


def _nodes(leaves: Leaves) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.uint16]]:
    """Return leaf, parent and word of every node; see `walk_leaves`."""
    total = linear_octree.count_nodes(leaves.code, leaves.depth)
    leaf, parent = np.empty(total, np.int32), np.empty(total, np.int32)
    word = np.empty(total, np.uint16)
    state = np.where(leaves.log_odds >= 0, OCCUPIED, FREE).astype(np.uint8)
    linear_octree.walk_leaves(leaves.code, leaves.depth, state, leaf, parent, word)
    return leaf, parent, word


def _children(word: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return bit c for every child c that a word tells anything of."""
    bits = (word | word >> 1) & 0x5555
    for shift, mask in ((1, 0x3333), (2, 0x0F0F), (4, 0x00FF)):
        bits = (bits | bits >> shift) & mask
    return bits.astype(np.uint8)


def _header(first_line: str, header: _Header) -> bytes:
    kind, num_nodes, resolution_m = header
    short = f"{resolution_m:g}"  # as C++ prints it; but a map must not shrink by being saved.
    res = short if float(short) == resolution_m else repr(resolution_m)
    return f"{first_line}\n{_COMMENT}\nid {kind}\nsize {num_nodes}\nres {res}\ndata\n".encode()


def _parsed(data: bytes, first_line: str) -> tuple[_Header, bytes]:
    """Return the header and the bytes behind it."""
    if not data.startswith(first_line.encode()):
        raise BadMapFile(f"it begins {data[:32]!r}; it must begin {first_line!r}")
    end = re.search(rb"\ndata[^\n]*\n", data[:_LONGEST_HEADER])
    if end is None:
        raise BadMapFile(f"no line 'data' ends the header within {_LONGEST_HEADER} bytes")
    fields = {}
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        key, _, value = line.strip().partition(" ")
        fields[key] = value.strip()
    kind = fields.get("id", "")
    if kind not in _RECORDS:
        raise BadMapFile(f"id {kind!r}; known: {', '.join(_RECORDS)}")
    try:
        num_nodes, resolution_m = int(fields["size"]), float(fields["res"])
    except (KeyError, ValueError) as error:
        raise BadMapFile(f"the header has no usable size and res: {error}") from error
    if num_nodes < 0 or not (math.isfinite(resolution_m) and resolution_m > 0.0):
        raise BadMapFile(
            f"size {num_nodes} must not be negative, res {resolution_m} must be positive and finite"
        )
    return _Header(kind, num_nodes, resolution_m), data[end.end() :]


def _check_walk(count: int, used: int, available: int, itemsize: int) -> None:
    if count < 0:
        what = "lies below depth 16" if count == TOO_DEEP else "is missing: the file is cut short"
        raise BadMapFile(f"node {used} {what}")
    if used != available:
        raise BadMapFile(f"{(available - used) * itemsize} bytes follow the last node")
