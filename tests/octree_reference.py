"""An octree the slow and obvious way: recursion over voxels, as OctoMap's text describes it."""

import struct

import numpy as np

from services.kernels.bricks import UNKNOWN
from services.mapper.box import Box
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.stored_map import StoredMap

WHITE = (255, 255, 255)
Voxel = tuple[int, tuple[int, int, int]]
Voxels = dict[tuple[int, int, int], Voxel]
"""By OctoMap's key: log-odds in 1/8192 and color."""
Node = tuple[int, tuple[int, int, int], dict[int, "Node"]]
"""Log-odds, color, children by number."""


def voxels_of(stored: StoredMap) -> Voxels:
    """Return what a map knows, voxel by voxel."""
    rows, local = np.nonzero(stored.log_odds != UNKNOWN)
    inside = np.stack([local >> 6, local >> 3 & 7, local & 7], axis=1)
    keys = stored.bricks[rows].astype(int) * 8 + inside + stored.box.first_key + 32768
    white = np.full((len(rows), 3), 255)
    color = white if stored.color is None else stored.color[rows, local]
    log_odds = stored.log_odds[rows, local].tolist()
    return {
        tuple(k): (v, tuple(c))
        for k, v, c in zip(keys.tolist(), log_odds, color.tolist(), strict=True)
    }


def tree_of(voxels: Voxels, depth: int = 0) -> Node:
    """Build the pruned tree; inner nodes have the largest log-odds and the mean set color."""
    if depth == 16:
        ((log_odds, color),) = voxels.values()
        return log_odds, color, {}
    parts: dict[int, Voxels] = {}
    bit = 1 << (15 - depth)
    for (x, y, z), voxel in voxels.items():
        child = bool(x & bit) + 2 * bool(y & bit) + 4 * bool(z & bit)
        parts.setdefault(child, {})[x, y, z] = voxel
    children = {child: tree_of(part, depth + 1) for child, part in sorted(parts.items())}
    nodes = list(children.values())
    if len(nodes) == 8 and all(node == nodes[0] and not node[2] for node in nodes):
        return nodes[0]
    colors = [color for _, color, _ in nodes if color != WHITE]
    mean = [sum(channel) // len(colors) for channel in zip(*colors, strict=True)]
    return max(node[0] for node in nodes), tuple(mean) if colors else WHITE, children


def bt_body(node: Node) -> bytes:
    """Return a node of a `.bt` and what is below it; log-odds are 0 (occupied) or negative."""
    word = 0
    for child, (log_odds, _, below) in node[2].items():
        word |= (3 if below else 2 if log_odds >= 0 else 1) << 2 * child
    inner = [bt_body(child) for child in node[2].values() if child[2]]
    return struct.pack("<H", word) + b"".join(inner)


def ot_body(node: Node, colored: bool) -> bytes:
    """Return a node of a `.ot` and what is below it."""
    log_odds, color, children = node
    data = struct.pack("<f", log_odds / LOG_ODDS_SCALE) + bytes(color if colored else ())
    mask = sum(1 << child for child in children)
    return data + bytes([mask]) + b"".join(ot_body(c, colored) for c in children.values())


def size_of(node: Node) -> int:
    """Count nodes."""
    return 1 + sum(size_of(child) for child in node[2].values())


def random_map(rng: np.random.Generator, box: Box, colored: bool) -> StoredMap:
    """A quarter of the bricks each: not there, one value, few values in cubes of 4, random."""
    index = np.argwhere(np.ones(box.num_bricks)).astype(np.int16)
    index = index[rng.permutation(len(index))]
    mixed = rng.integers(-16384, 28000, (len(index), 8, 8, 8))
    mixed[rng.random(mixed.shape) < 0.3] = UNKNOWN
    coarse = rng.choice([-16384, 28000, UNKNOWN], (len(index), 2, 2, 2))
    coarse = coarse.repeat(4, axis=1).repeat(4, axis=2).repeat(4, axis=3)
    kind = rng.integers(0, 4, (len(index), 1, 1, 1))
    log_odds = np.choose(kind, [UNKNOWN, -16384, coarse, mixed]).astype(np.int16)
    color = None
    if colored:
        color = rng.integers(0, 256, (len(index), 512, 3)).astype(np.uint8)
        color[rng.random(color.shape[:2]) < 0.4] = 255
        color[kind.reshape(-1) < 3] = 255
        color[log_odds.reshape(-1, 512) == UNKNOWN] = 255
    kept = kind.reshape(-1) > 0
    return StoredMap(
        box,
        SensorModel(),
        index[kept],
        log_odds.reshape(-1, 512)[kept],
        None if color is None else color[kept],
    )
