"""Marked voxels: one bit per voxel of a brick, set in any order, taken in brick by brick.

A scan updates every voxel once and a hit beats a miss: bits forget how often they were set, and
hits are taken off the misses before either is added.
"""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS, close_brick, open_brick
from services.kernels.fade import is_lowest, refresh

WORDS = 8
"""64-bit words of marks per brick: word i, bit 8 * j + k of voxel (i, j, k)."""


@njit(cache=True, error_model="numpy", nogil=True)
def expand(words, out):  # type: ignore[no-untyped-def]
    """Write the bits of words (WORDS,) into out (512,) int32; return how many are set."""
    count = np.int32(0)
    for w in range(WORDS):
        word = words[w]
        row = out[w * 64 : w * 64 + 64]
        for b in range(64):
            row[b] = np.int32((word >> np.uint64(b)) & np.uint64(1))
    for i in range(VOXELS):
        count += out[i]
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def spare(free, words):  # type: ignore[no-untyped-def]
    """Clear free (512,) int32 in place where a bit is set in words: hit beats miss."""
    for w in range(WORDS):
        word = words[w]
        row = free[w * 64 : w * 64 + 64]
        for b in range(64):
            row[b] = row[b] & ~np.int32((word >> np.uint64(b)) & np.uint64(1))


@njit(cache=True, error_model="numpy", nogil=True)
def hit_some(row, hit_here, hit, low, high):  # type: ignore[no-untyped-def]
    """Add a hit in place to the voxels of a brick (512,) where hit_here is 1."""
    lower, upper, step = np.int32(low), np.int32(high), np.int32(hit)
    for i in range(VOXELS):
        value = np.int32(row[i])
        prior = np.int32(0) if value == UNKNOWN else value
        updated = min(max(prior + step, lower), upper)
        row[i] = np.int16(updated if hit_here[i] != 0 else value)


@njit(cache=True, error_model="numpy", nogil=True)
def miss_some(row, free, miss, low):  # type: ignore[no-untyped-def]
    """Add a miss in place where free is 1; return how many voxels are above the lower clamp."""
    above = np.int32(0)
    lower, step = np.int32(low), np.int32(miss)
    for i in range(VOXELS):
        value = np.int32(row[i])
        prior = np.int32(0) if value == UNKNOWN else value
        updated = max(prior + step, lower) if free[i] != 0 else value
        row[i] = np.int16(updated)
        above += np.int32(updated != lower)
    return above


@njit(cache=True, error_model="numpy", nogil=True)
def merge(marks, other):  # type: ignore[no-untyped-def]
    """Add the marks of `other` to `marks` and wipe `other`."""
    for n in range(marks.size):
        marks[n] |= other[n]
        other[n] = 0


@njit(cache=True, error_model="numpy", nogil=True)
def take_in(bricks, hits, misses, update):  # type: ignore[no-untyped-def]
    """Add one hit or one miss to every marked voxel and wipe the marks; write `bricks` in place.

    Args:
        hits, misses: (B * WORDS,) uint64, read and wiped.
        update: hit, miss, low, high in 1/8192.
    """
    hit, miss, low, high = update
    chosen = np.empty(VOXELS, np.int32)
    slots, log_odds, dirty = bricks.slot, bricks.log_odds, bricks.dirty
    for brick in range(slots.size):
        mine = slice(brick * WORDS, (brick + 1) * WORDS)
        hit_words, miss_words = hits[mine], misses[mine]
        some_hit, some = np.uint64(0), np.uint64(0)
        for w in range(WORDS):
            some_hit |= hit_words[w]
            some |= hit_words[w] | miss_words[w]
        if some == 0:
            continue
        if some_hit != 0 or not is_lowest(bricks, brick, low):
            refresh(bricks, brick)
            slot = slots[brick]
            if slot == UNIFORM:
                slot = open_brick(bricks, brick)
            dirty[brick] = 1
            row = log_odds[slot]
            if some_hit != 0:
                expand(hit_words, chosen)
                hit_some(row, chosen, hit, low, high)
            for w in range(WORDS):
                miss_words[w] &= ~hit_words[w]
            expand(miss_words, chosen)
            if miss_some(row, chosen, miss, low) == 0:
                close_brick(bricks, brick, np.int16(low))
        hit_words[:] = 0
        miss_words[:] = 0
