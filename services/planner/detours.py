"""Ways around each other: how much farther out cameras fly so that none meets another."""

import numpy as np
from numpy.typing import NDArray

from services.kernels.detour import part
from services.kernels.rigid import FloatArray
from services.planner.course import Course

_FARTHEST, _NUM_STEPS = 10.0, 41
"""Detours that are tried: up to so many safe distances, this many."""
_CLOSE = 0.999
"""Of the distance that is asked for: nearer counts as too near."""
_TRIES = 4
"""So many times, for each camera, one of a pair is moved before what is left is left."""
_MOST = 64
"""Pairs that are looked at, whatever their number: of a crowd the rest is left as it is."""
_LONGER = 1e-3
"""m of distance that one m of detour weighs: among clear ways the shortest is taken."""


def bump(share: FloatArray) -> FloatArray:
    """Return the shape of a detour: nothing at shares 0 and 1, all half-way."""
    shape: FloatArray = 4 * share * (1 - share)
    return shape


def detours(
    ways: Course, share: FloatArray, safe_m: float, over: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Return (N,) how much farther out each camera flies half-way, to keep clear of the others.

    Of the pair that comes nearest beyond what is allowed one camera takes the shortest detour
    that is clear of all others, or, if none is, of as many as can be; so on until no pair is too
    near. Pairs that begin or end nearer than `safe_m` keep that distance instead. Outward only:
    nobody comes nearer to the target than without.

    Args:
        ways: of N cameras without detours, at S instants: (S, N).
        share: (S,) of the change that is done at each, from 0 to 1.
        safe_m: distance to be kept.
        over: (N,) whose detours keep the direction, not the climb; none if not given.

    Source: prioritised planning, Erdmann and Lozano-Perez, "On multiple moving objects", 1987,
    with the order of cameras found on the way.
    """
    num = ways.range_m.shape[1]
    out_m = np.zeros(num)
    if num < 2:
        return out_m
    first, last = (_apart(arms) for arms in ways.arms_m()[[0, -1]])
    part(
        np.ascontiguousarray(ways.range_m.T),
        np.ascontiguousarray(ways.theta_rad.T),
        np.ascontiguousarray(ways.climb_m.T),
        np.zeros(num, np.bool_) if over is None else over,
        bump(share),
        np.linspace(0.0, _FARTHEST * safe_m, _NUM_STEPS),
        _LONGER,
        _CLOSE * np.minimum(np.minimum(first, last), safe_m),
        min(_TRIES * num, _MOST),
        out_m,
    )
    return out_m


def _apart(places_m: FloatArray) -> FloatArray:
    """Return (N, N) distances of (N, 3) places."""
    apart: FloatArray = np.linalg.norm(places_m[:, None] - places_m, axis=-1)
    return apart
