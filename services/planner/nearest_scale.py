"""The feasible scale that is nearest to one that is not."""

from collections.abc import Callable

import numpy as np

_REACH = 100.0
"""Scales are tried up to this factor to either side."""


def nearest_scale(
    holds: Callable[[float], bool],
    wished_m: float,
    resolution_m: float = 1e-3,
    ratio: float = 1.06,
    may_go_on: Callable[[], bool] = lambda: True,
) -> float | None:
    """Return the nearest scale that holds, or None.

    Args:
        holds: whether a scale, m, is feasible.
        wished_m: one that is not.
        resolution_m: of the answer, which is rounded into what is feasible.
        ratio: of the scales that are tried; a narrower interval of feasible ones may be
            overlooked.
        may_go_on: whether there is time for more; if not, what holds so far is the answer.
    """
    before, factor = 1.0, ratio
    while factor < _REACH and may_go_on():
        # To both sides: either may be the nearer.
        sides = ((wished_m / factor, wished_m / before), (wished_m * factor, wished_m * before))
        found = [
            _edge(holds, inside_m, outside_m, resolution_m, may_go_on)
            for inside_m, outside_m in sides
            if holds(inside_m)
        ]
        if found:
            return min(found, key=lambda scale_m: abs(scale_m - wished_m))
        before, factor = factor, factor * ratio
    return None


def _edge(
    holds: Callable[[float], bool],
    inside_m: float,
    outside_m: float,
    resolution_m: float,
    may_go_on: Callable[[], bool],
) -> float:
    """Halve the way between a scale that holds and one that does not."""
    while abs(inside_m - outside_m) > resolution_m / 4:
        if not may_go_on():
            return inside_m
        middle_m = (inside_m + outside_m) / 2
        if holds(middle_m):
            inside_m = middle_m
        else:
            outside_m = middle_m
    towards, rounded = (1, np.floor) if outside_m > inside_m else (-1, np.ceil)
    whole = int(rounded(inside_m / resolution_m))
    # A round number that holds may be just beyond the place where the halving ended.
    for steps in (whole + towards, whole):
        if steps > 0 and holds(steps * resolution_m):
            return steps * resolution_m
    return inside_m
