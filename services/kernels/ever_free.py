"""Voxels that were free for long and then become occupied: something has come there.

One byte per voxel: how many instants it has surely been free, until that is EVER; from then on how
many instants it has been occupied since, and whether it is flagged as dynamic. A brick whose bytes
are equal has one.

Source: Schmid et al., Dynablox, RA-L 8(10), 2023, sec. IV: ever-free voxels and their neighbours.
Here the neighbours are asked when a voxel is to be flagged, and not at every instant.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.kernels.bricks import SEEN, UNIFORM, UNKNOWN, VOXELS

EVER = 64
"""Ever free, and free now; EVER + n: occupied for n instants."""
DYNAMIC = 128
"""Added when flagged."""
MOST_INSTANTS = EVER - 1
ONE = -1
"""Row of a brick whose voxels all hold `EverFree.value`."""


class EverFree(NamedTuple):
    """The arrays beside those of B bricks, with R rows."""

    row: NDArray[np.int32]
    """(B,) row of `state`, or ONE."""
    value: NDArray[np.uint8]
    """(B,) state of all voxels of a brick that has no row."""
    state: NDArray[np.uint8]
    """(R, 512)."""
    free_rows: NDArray[np.int32]
    """(R,) a stack of unused rows; its height is `num_free[0]`."""
    num_free: NDArray[np.int64]
    """(1,)"""


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def after(state, log_odds, enough, frames, stay):  # type: ignore[no-untyped-def]
    """Return a voxel's state one instant later.

    Args:
        enough: log-odds at or below which it is surely free.
        frames: instants that it must surely be free; stay: occupied ones after which it is part of
            the background.
    """
    s, value = np.int32(state), np.int32(log_odds)
    free, occupied = (value <= enough) & (value != UNKNOWN), value >= 0
    longer = np.int32(EVER) if s + 1 >= frames else s + 1
    young = longer if free else (np.int32(0) if occupied else s)
    since = (s & np.int32(EVER - 1)) + 1
    taken = np.int32(0) if since > stay else s + 1
    old = taken if occupied else np.int32(EVER)
    return np.uint8(old if s >= EVER else young)


@njit(cache=True, error_model="numpy", nogil=True)
def step_row(states, log_odds, enough, frames, stay):  # type: ignore[no-untyped-def]
    """Take 512 voxels one instant further in place; return the least and the greatest state."""
    least, greatest = np.int32(255), np.int32(0)
    for i in range(VOXELS):
        states[i] = after(states[i], log_odds[i], enough, frames, stay)
        least, greatest = min(least, np.int32(states[i])), max(greatest, np.int32(states[i]))
    return least, greatest


@njit(cache=True, error_model="numpy", nogil=True)
def observe(ever, bricks, first, enough, frames, stay, listed, count):  # type: ignore[no-untyped-def]
    """Take every brick that was looked at one instant further; write `ever`, `bricks.dirty`.

    Looked at are bricks written since they were last observed, and those that are surely free
    altogether: no miss can change them.

    Args:
        first: the brick to go on with. enough, frames, stay: see `after`.
        listed: (B,) int32, written from `count` on: bricks with voxels that have been occupied.

    Returns:
        The brick to go on with (B when done, less if the pool of rows is exhausted), and the count.
    """
    uniform_row = np.empty(VOXELS, np.int16)
    for brick in range(first, bricks.slot.size):
        slot, value, row = bricks.slot[brick], bricks.value[brick], ever.row[brick]
        # Not if only its changes have yet to be told.
        written = bricks.dirty[brick] & 1
        if not written:
            surely_free = slot == UNIFORM and value <= enough and value != UNKNOWN
            if not surely_free or (row == ONE and ever.value[brick] == EVER):
                continue
        if row == ONE and slot == UNIFORM:
            state = after(ever.value[brick], value, enough, frames, stay)
            if state <= EVER:
                ever.value[brick] = state
                bricks.dirty[brick] = SEEN if written else bricks.dirty[brick]
                continue
        if row == ONE:
            height = ever.num_free[0]
            if height == 0:
                return brick, count
            row = ever.free_rows[height - 1]
            ever.num_free[0] = height - 1
            ever.row[brick] = row
            ever.state[row, :] = ever.value[brick]
        bricks.dirty[brick] = SEEN if written else bricks.dirty[brick]
        if slot == UNIFORM:
            uniform_row[:] = value
            least, greatest = step_row(ever.state[row], uniform_row, enough, frames, stay)
        else:
            log_odds = bricks.log_odds[slot]
            least, greatest = step_row(ever.state[row], log_odds, enough, frames, stay)
        if least == greatest and least <= EVER:
            release(ever, brick, least)
        elif greatest > EVER:
            listed[count] = brick
            count += 1
    return bricks.slot.size, count


@njit(cache=True, error_model="numpy", nogil=True)
def release(ever, brick, state):  # type: ignore[no-untyped-def]
    """Give a brick's row back: all its voxels have one state."""
    ever.free_rows[ever.num_free[0]] = ever.row[brick]
    ever.num_free[0] += 1
    ever.row[brick] = ONE
    ever.value[brick] = np.uint8(state)


@njit(cache=True, error_model="numpy", nogil=True)
def touches(ever, shape, address, low, high):  # type: ignore[no-untyped-def]
    """Return whether one of the 26 neighbours of a voxel has a state in low..high; outside it is 0.

    Args:
        address: brick * 512 + voxel.
    """
    ny, nz = shape[1], shape[2]
    brick, n = address // VOXELS, address % VOXELS
    q = brick // nz
    i0, j0, k0 = q // ny * 8 + (n >> 6), q % ny * 8 + ((n >> 3) & 7), brick % nz * 8 + (n & 7)
    for i in range(i0 - 1, i0 + 2):
        for j in range(j0 - 1, j0 + 2):
            for k in range(k0 - 1, k0 + 2):
                if i == i0 and j == j0 and k == k0:
                    continue
                state = np.int32(0)
                if i >= 0 and j >= 0 and k >= 0 and i < shape[0] * 8 and j < ny * 8 and k < nz * 8:
                    other = ((i >> 3) * ny + (j >> 3)) * nz + (k >> 3)
                    row = ever.row[other]
                    local = ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)
                    state = np.int32(ever.value[other] if row == ONE else ever.state[row, local])
                if low <= state <= high:
                    return True
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def flag_some(ever, shape, pending, count, low, high, wanted):  # type: ignore[no-untyped-def]
    """Flag the pending voxels of which it is `wanted` that they touch low..high, in place.

    Args:
        pending: (P,) int64 addresses, of which the first `count`; those not flagged are moved up.

    Returns:
        How many are left.
    """
    left = 0
    for p in range(count):
        address = pending[p]
        if touches(ever, shape, address, low, high) == wanted:
            ever.state[ever.row[address // VOXELS], address % VOXELS] += np.uint8(DYNAMIC)
        else:
            pending[left] = address
            left += 1
    return left


@njit(cache=True, error_model="numpy", nogil=True)
def flag(ever, shape, listed, count):  # type: ignore[no-untyped-def]
    """Flag the voxels of listed bricks that are occupied after having been ever free, in place.

    Those of which every neighbour has been ever free too: not the rim of a surface, which noise
    fills now and then. Then those that touch a flagged one, as long as there are any.
    """
    pending = np.empty(count * VOXELS, np.int64)
    num = 0
    for p in range(count):
        states = ever.state[ever.row[listed[p]]]
        for n in range(VOXELS):
            if EVER < states[n] < DYNAMIC:
                pending[num] = np.int64(listed[p]) * VOXELS + n
                num += 1
    num = flag_some(ever, shape, pending, num, 0, EVER - 1, False)
    before = num + 1
    while num < before:
        before = num
        num = flag_some(ever, shape, pending, num, DYNAMIC + 1, 255, True)


@njit(cache=True, error_model="numpy", nogil=True)
def count_dynamic(ever):  # type: ignore[no-untyped-def]
    """Return how many voxels are flagged."""
    total = np.int64(0)
    for brick in range(ever.row.size):
        if ever.row[brick] != ONE:
            count = np.int32(0)
            states = ever.state[ever.row[brick]]
            for n in range(VOXELS):
                count += np.int32(states[n] > DYNAMIC)
            total += count
    return total
