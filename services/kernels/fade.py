"""Forgetting, brick by brick and no sooner than needed: log-odds halve every half-life.

A brick stores its log-odds as they were at `faded`; now they are 2^-((now - faded) / half-life)
times that. Signs do not fade, so a brick's classes are right without touching it until its weakest
voxel is forgotten, at `expiry`. Who writes a brick calls `refresh` first, who reads classes
`settle`, who reads log-odds `fade_all`. Neither rewrites a brick younger than a grain, except to
forget: however often a map is read, it forgets as fast.
"""

import numpy as np
from numba import njit

from services.kernels.bricks import UNIFORM, UNKNOWN, VOXELS, close_brick

FORGOTTEN = 819
"""Log-odds (1/8192) below which a voxel that fades becomes unknown: |p - 0.5| < 0.025."""
GRAIN = 128.0
"""Steps per half-life in which bricks fade: in finer ones rounding would undo the fading (FORGOTTEN
loses 4 units in such a step). Log-odds are right to 0.6 %."""
NOTHING = 65536
"""Least size of log-odds in a brick that knows nothing."""


@njit(cache=True, error_model="numpy", nogil=True)
def fade_row(row, factor, least):  # type: ignore[no-untyped-def]
    """Scale 512 log-odds towards even odds in place; unknown once nearer than `least`.

    Returns:
        How many are forgotten by it, and the least size of those still known (NOTHING if none is).
    """
    forgotten, weakest = np.int32(0), np.int32(NOTHING)
    half = np.float32(0.5)
    for i in range(VOXELS):
        before = np.int32(row[i])
        scaled = np.float32(before) * factor
        size = abs(scaled)
        gone = (before == UNKNOWN) | (size < least)
        rounded = np.int32(size + half)
        row[i] = np.int16(UNKNOWN if gone else (rounded if before >= 0 else -rounded))
        forgotten += np.int32(gone & (before != UNKNOWN))
        weakest = min(weakest, np.int32(NOTHING) if gone else rounded)
    return forgotten, weakest


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def is_young(bricks, brick):  # type: ignore[no-untyped-def]
    """Return whether a brick's log-odds are right to a grain as they are stored."""
    return (bricks.clock[0] - bricks.faded[brick]) * GRAIN < bricks.clock[1]


@njit(cache=True, error_model="numpy", nogil=True)
def fade_brick(bricks, brick):  # type: ignore[no-untyped-def]
    """Bring a brick's log-odds to the present; return the least size known, NOTHING if none is.

    One younger than a grain keeps its log-odds and its age: it only forgets.
    """
    now, half_life = bricks.clock[0], bricks.clock[1]
    age = now - bricks.faded[brick]
    factor, least = np.float32(np.exp2(-age / half_life)), np.float32(FORGOTTEN)
    if is_young(bricks, brick):
        factor, least = np.float32(1.0), least / factor
    else:
        bricks.faded[brick] = now
    slot = bricks.slot[brick]
    if slot != UNIFORM:
        forgotten, weakest = fade_row(bricks.log_odds[slot], factor, least)
        bricks.dirty[brick] |= forgotten > 0
        return weakest
    before = np.int32(bricks.value[brick])
    if before == UNKNOWN:
        return np.int32(NOTHING)
    size = np.float32(abs(before)) * factor
    if size < least:
        bricks.value[brick] = UNKNOWN
        bricks.dirty[brick] = 1
        return np.int32(NOTHING)
    rounded = np.int32(size + np.float32(0.5))
    bricks.value[brick] = np.int16(rounded if before >= 0 else -rounded)
    return rounded


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def refresh(bricks, brick):  # type: ignore[no-untyped-def]
    """Bring a brick to the present before it is written; it keeps its slot.

    What is written may be weak, so the brick is settled as soon as time has passed.
    """
    if bricks.clock[1] < np.inf:
        if not is_young(bricks, brick):
            fade_brick(bricks, brick)
        bricks.expiry[brick] = bricks.clock[0]


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def is_lowest(bricks, brick, low):  # type: ignore[no-untyped-def]
    """Return whether a miss can change nothing: uniform, at the lower clamp, and not faded since.

    What fades must be refreshed and missed: being seen again is what keeps it known.
    """
    lowest = bricks.slot[brick] == UNIFORM and bricks.value[brick] == low
    return lowest and is_young(bricks, brick)


@njit(cache=True, error_model="numpy", nogil=True)
def settle_brick(bricks, brick):  # type: ignore[no-untyped-def]
    """Fade a brick and set its expiry; one that knows nothing any more gives its slot back."""
    weakest = fade_brick(bricks, brick)
    if weakest == NOTHING:
        close_brick(bricks, brick, np.int16(UNKNOWN))
        bricks.expiry[brick] = np.inf
        return
    half_lives = np.log2(weakest / FORGOTTEN)
    bricks.expiry[brick] = bricks.faded[brick] + bricks.clock[1] * half_lives


@njit(cache=True, error_model="numpy", nogil=True)
def settle(bricks):  # type: ignore[no-untyped-def]
    """Make every class what it is now; return how many bricks had to be faded for it.

    A brick that neither was written nor has expired costs one comparison.
    """
    count = 0
    if bricks.clock[1] == np.inf:
        return count
    expiry, now = bricks.expiry, bricks.clock[0]
    for brick in range(expiry.size):
        if expiry[brick] < now:
            settle_brick(bricks, brick)
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def fade_all(bricks):  # type: ignore[no-untyped-def]
    """Make every log-odds value what it is now, to a grain; return how many bricks it took."""
    count = 0
    now = bricks.clock[0]
    for brick in range(bricks.slot.size):
        known = bricks.slot[brick] != UNIFORM or bricks.value[brick] != UNKNOWN
        stale = not is_young(bricks, brick) or bricks.expiry[brick] < now
        if known and bricks.clock[1] < np.inf and stale:
            settle_brick(bricks, brick)
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def begin(bricks, half_life):  # type: ignore[no-untyped-def]
    """Take another half-life, s, from now on (call `fade_all` first); what is known is settled.

    What a young brick has yet to fade by it will, in the pace of the new half-life.
    """
    now, before = bricks.clock[0], bricks.clock[1]
    bricks.clock[1] = half_life
    fades = half_life < np.inf and before < np.inf
    for brick in range(bricks.slot.size):
        known = bricks.slot[brick] != UNIFORM or bricks.value[brick] != UNKNOWN
        faded = bricks.faded[brick]
        bricks.faded[brick] = now
        if known and fades:
            bricks.faded[brick] -= (now - faded) / before * half_life
        bricks.expiry[brick] = now if known else np.inf
