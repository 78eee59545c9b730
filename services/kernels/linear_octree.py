"""Octrees without pointers: leaves in Morton order, and nodes in the order of a depth-first walk.

A leaf is its code (48 bits: the Morton code of its first voxel, x lowest), its depth (0 the root,
16 a voxel) and a value. Source of the linear octree: Gargantini, An effective way to represent
quadtrees, CACM 25(12), 1982.
"""

import numpy as np
from numba import njit

from services.kernels.bricks import VOXELS

DEPTH = 16
"""Depth of a voxel; keys have as many bits (OctoMap's)."""
BRICK_DEPTH = 13
FREE, OCCUPIED, INNER = 1, 2, 3
"""What two bits tell of a child in OctoMap's `.bt`; 0 is unknown."""
TOO_SHORT, TOO_DEEP = -1, -2
"""What the walks return for data that end early, or go below voxels."""
_SPREAD = np.array([0, 1, 8, 9, 64, 65, 72, 73])  # three bits, each at every third place.


@njit(cache=True, error_model="numpy", nogil=True)
def scatter_rows(values, corner, rows, out):  # type: ignore[no-untyped-def]
    """Move bricks that lie anywhere into the octree's bricks of 8^3, voxels in Morton order.

    Args:
        values: (M, 512), element 64*i + 8*j + k. corner: (M, 3) key of the first voxel.
        rows: (M, 8) rows of `out` that the brick's corners lie in, lowest bit x.
        out: (A, 512); written.
    """
    for m in range(values.shape[0]):
        x, y, z = corner[m, 0] & 7, corner[m, 1] & 7, corner[m, 2] & 7
        for n in range(VOXELS):
            i, j, k = x + (n >> 6), y + ((n >> 3) & 7), z + (n & 7)
            row = rows[m, (i >> 3) | (j >> 3 << 1) | (k >> 3 << 2)]
            out[row, _SPREAD[i & 7] | _SPREAD[j & 7] << 1 | _SPREAD[k & 7] << 2] = values[m, n]


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def is_uniform(row):  # type: ignore[no-untyped-def]
    """Whether all elements are equal."""
    differing = np.int32(0)
    for i in range(row.size):
        differing += np.int32(row[i] != row[0])
    return differing == 0


@njit(cache=True, error_model="numpy", nogil=True)
def collapse(code, depth, value, count):  # type: ignore[no-untyped-def]
    """Replace the last eight leaves by one while they are equal siblings; return the new count."""
    while count >= 8:
        first, d = count - 8, depth[count - 1]
        parent = code[count - 1] >> 3 * (DEPTH - d + 1) << 3 * (DEPTH - d + 1)
        if code[first] != parent or depth[first] != d or value[first] != value[count - 1]:
            return count
        for n in range(first + 1, count):
            if depth[n] != d or value[n] != value[first]:
                return count
        depth[first] = d - 1
        count = first + 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def prune(brick_code, values, unknown, code, depth, value):  # type: ignore[no-untyped-def]
    """List the leaves of the pruned octree.

    Args:
        brick_code: (A,) ascending Morton codes of bricks. values: (A, 512) in Morton order.
        unknown: the value of a voxel that is none.
        code, depth, value: (L,) of leaves, L at least the known voxels; written.

    Returns:
        The number of leaves.
    """
    count = 0
    for row in range(values.shape[0]):
        line, base = values[row], brick_code[row] << 9
        if is_uniform(line):
            if line[0] != unknown:
                code[count], depth[count], value[count] = base, BRICK_DEPTH, line[0]
                count = collapse(code, depth, value, count + 1)
            continue
        for n in range(VOXELS):
            if line[n] == unknown:
                continue
            code[count], depth[count], value[count] = base | n, DEPTH, line[n]
            count += 1
            if n & 7 == 7:
                count = collapse(code, depth, value, count)
    return count


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def common_depth(one, other):  # type: ignore[no-untyped-def]
    """Return the depth of the deepest node that holds both codes."""
    rest, depth = one ^ other, DEPTH
    while rest != 0:
        rest >>= 3
        depth -= 1
    return depth


@njit(cache=True, error_model="numpy", nogil=True)
def count_nodes(code, depth):  # type: ignore[no-untyped-def]
    """Count the leaves (in Morton order) and the nodes above them."""
    count = code.size
    for n in range(code.size):
        first = 0 if n == 0 else common_depth(code[n - 1], code[n]) + 1
        count += depth[n] - first
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def walk_leaves(code, depth, state, leaf, parent, word):  # type: ignore[no-untyped-def]
    """List all nodes depth first, as OctoMap writes them.

    Args:
        code, depth: (L,) leaves. state: (L,) FREE or OCCUPIED.
        leaf: (N,) the node's leaf, -1 if it is an inner node; written.
        parent: (N,) the node's parent, -1 for the root; written.
        word: (N,) uint16, bits 2*c and 2*c + 1 tell of child c; written.
    """
    path = np.empty(DEPTH + 1, np.int32)
    node = np.int32(0)
    for n in range(code.size):
        first = 0 if n == 0 else common_depth(code[n - 1], code[n]) + 1
        for d in range(first, depth[n] + 1):
            above = np.int32(-1) if d == 0 else path[d - 1]
            is_leaf = d == depth[n]
            if d > 0:
                child = (code[n] >> 3 * (DEPTH - d)) & 7
                word[above] |= np.uint16((state[n] if is_leaf else INNER) << 2 * child)
            leaf[node] = n if is_leaf else -1
            parent[node], word[node], path[d] = above, 0, node
            node += 1


@njit(cache=True, error_model="numpy", nogil=True)
def raise_largest(value, parent):  # type: ignore[no-untyped-def]
    """Give every node (N,), leaves filled and inner nodes lowest, the largest of its children."""
    for n in range(value.size - 1, 0, -1):
        value[parent[n]] = max(value[parent[n]], value[n])


@njit(cache=True, error_model="numpy", nogil=True)
def raise_colors(color, leaf, parent, unset):  # type: ignore[no-untyped-def]
    """Give every inner node's color (N, 3) uint8 the mean of its children's, save the unset ones.

    Source: OctoMap's ColorOcTreeNode::getAverageChildColor; `unset` on all three channels is none.
    """
    total = np.zeros((color.shape[0], 3), np.int32)
    count = np.zeros(color.shape[0], np.int32)
    for n in range(color.shape[0] - 1, -1, -1):
        if leaf[n] < 0:
            for c in range(3):
                color[n, c] = total[n, c] // count[n] if count[n] else unset
        if n and (color[n, 0] != unset or color[n, 1] != unset or color[n, 2] != unset):
            total[parent[n]] += color[n]
            count[parent[n]] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def walk_words(words, code, depth, occupied):  # type: ignore[no-untyped-def]
    """Read what a `.bt` holds: leaves in Morton order.

    Args:
        words: (W,) uint16 per inner node, depth first.
        code, depth, occupied: (8 W,) of leaves; written.

    Returns:
        Leaves and words read, or TOO_SHORT or TOO_DEEP and the word at which.
    """
    open_word = np.zeros(DEPTH, np.uint16)
    next_child = np.zeros(DEPTH, np.int64)
    if words.size == 0:
        return 0, 0
    count, used, d, path = 0, 1, 0, np.int64(0)
    open_word[0] = words[0]
    while d >= 0:
        child = next_child[d]
        if child == 8:
            d -= 1
            path >>= 3
            continue
        next_child[d] += 1
        state = (open_word[d] >> np.uint16(2 * child)) & 3
        if state == INNER:
            if d + 1 == DEPTH:
                return TOO_DEEP, used
            if used == words.size:
                return TOO_SHORT, used
            d += 1
            path = path << 3 | child
            open_word[d], next_child[d] = words[used], 0
            used += 1
        elif state != 0:
            code[count] = (path << 3 | child) << 3 * (DEPTH - d - 1)
            depth[count], occupied[count] = d + 1, state == OCCUPIED
            count += 1
    return count, used


@njit(cache=True, error_model="numpy", nogil=True)
def walk_children(children, code, depth, node):  # type: ignore[no-untyped-def]
    """Read the structure of a `.ot`: leaves in Morton order.

    Args:
        children: (N,) uint8, bit c: child c follows; nodes depth first.
        code, depth, node: (N,) of leaves, `node` the row it was read from; written.

    Returns:
        Leaves and nodes read, or TOO_SHORT or TOO_DEEP and the node at which.
    """
    rest = np.zeros(DEPTH + 1, np.int64)
    if children.size == 0:
        return 0, 0
    count, used, d, path = 0, 0, 0, np.int64(0)
    while True:
        if used == children.size:
            return TOO_SHORT, used
        rest[d] = children[used]
        if rest[d] == 0:
            code[count], depth[count], node[count] = path << 3 * (DEPTH - d), d, used
            count += 1
        elif d == DEPTH:
            return TOO_DEEP, used
        used += 1
        while d >= 0 and rest[d] == 0:
            d -= 1
            path >>= 3
        if d < 0:
            return count, used
        child = np.int64(0)
        while not (rest[d] >> child) & 1:
            child += 1
        rest[d] &= rest[d] - 1
        path = path << 3 | child
        d += 1
