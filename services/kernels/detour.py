"""Ways around a target that keep clear of each other: how much farther out each must lead.

A way is sampled: range, azimuth and climb (m, rad, m; see `planner/course.py`) at S instants. A
detour adds `bump`, zero at both ends, times so much to its range; the climb stays, or, of a way
that is `radial`, the direction.
"""

import numpy as np
from numba import njit

_SHORTEST_M = 1e-9


@njit(cache=True, error_model="numpy", nogil=True)
def trace(range_m, theta, climb, radial, bump, out, way):  # type: ignore[no-untyped-def]
    """Write where a way with a detour leads, relative to the centre; return its longest step, m.

    Args:
        range_m, theta, climb: (S,) of the way without it.
        radial: whether it keeps its directions.
        bump: (S,) shape of the detour, 0 to 1.
        out: how much farther out it leads, m.
        way: (S, 3) m; written.
    """
    longest = _SHORTEST_M
    for s in range(len(range_m)):
        reach = range_m[s] + bump[s] * out
        slope = climb[s] / max(range_m[s] if radial else reach, _SHORTEST_M)
        elevation = slope if slope > 0 else np.arcsin(max(slope, -1.0))
        level = reach * np.cos(elevation)
        way[s, 0], way[s, 1] = level * np.cos(theta[s]), level * np.sin(theta[s])
        way[s, 2] = reach * np.sin(elevation)
        if s > 0:
            dx, dy = way[s, 0] - way[s - 1, 0], way[s, 1] - way[s - 1, 1]
            dz = way[s, 2] - way[s - 1, 2]
            longest = max(longest, np.sqrt(dx * dx + dy * dy + dz * dz))
    return longest


@njit(cache=True, error_model="numpy", nogil=True)
def intrusion(one, other, step, allowed):  # type: ignore[no-untyped-def]
    """Return how much nearer than allowed two come, m; both go straight between samples.

    Args:
        one, other: (S, 3) m.
        step: no longer step is taken by both together, m; so far ahead need not be looked.
        allowed: m.
    """
    most, s = 0.0, 0
    while s < len(one) - 1:
        x, y, z = one[s, 0] - other[s, 0], one[s, 1] - other[s, 1], one[s, 2] - other[s, 2]
        free = int((np.sqrt(x * x + y * y + z * z) - allowed) / step)
        if free > 0:
            s += free
            continue
        s += 1
        u, v, w = one[s, 0] - other[s, 0], one[s, 1] - other[s, 1], one[s, 2] - other[s, 2]
        dx, dy, dz = u - x, v - y, w - z
        moved = dx * dx + dy * dy + dz * dz
        share = 0.0 if moved == 0.0 else -(x * dx + y * dy + z * dz) / moved
        share = min(max(share, 0.0), 1.0)
        a, b, c = x + share * dx, y + share * dy, z + share * dz
        most = max(most, allowed - np.sqrt(a * a + b * b + c * c))
    return most


@njit(cache=True, error_model="numpy", nogil=True)
def clearest(  # type: ignore[no-untyped-def]
    range_m, theta, climb, radial, bump, tried, longer, allowed, camera, ways, steps, own
):
    """Return (what the best detour of a camera lacks, its number among those tried).

    Args:
        range_m, theta, climb: (S,) of its way.
        radial, bump: as in `trace`.
        tried: (D,) detours, rising, m.
        longer: what a metre of detour weighs, m of distance.
        allowed: (N,) the distance it must keep from each, m.
        camera: its number.
        ways: (N, S, 3) of all.
        steps: (N,) the longest of each, m.
        own: (S, 3); overwritten.
    """
    best, chosen = np.inf, 0
    for d in range(len(tried)):
        lack = longer * tried[d]
        if lack >= best:
            break
        step = trace(range_m, theta, climb, radial, bump, tried[d], own)
        for other in range(len(ways)):
            if other != camera:
                lack += intrusion(own, ways[other], step + steps[other], allowed[other])
                if lack >= best:
                    break
        if lack < best:
            best, chosen = lack, d
    return best, chosen


@njit(cache=True, error_model="numpy", nogil=True)
def part(  # type: ignore[no-untyped-def]
    range_m, theta, climb, radial, bump, tried, longer, allowed, most, out
):
    """Write detours by which no two come nearer than allowed, as far as those tried have any.

    Of the pair that lacks most one takes the detour that lacks least; so on.

    Args:
        range_m, theta, climb: (N, S) of all ways.
        radial: (N,)
        bump, tried, longer: as in `clearest`.
        allowed: (N, N) distances to be kept, m.
        most: so many times a pair is looked at, at most.
        out: (N,) m; written.
    """
    num, num_samples = range_m.shape
    ways, own = np.empty((num, num_samples, 3)), np.empty((num_samples, 3))
    lack, steps = np.zeros((num, num)), np.empty(num)
    out[:] = 0.0
    for i in range(num):
        steps[i] = trace(range_m[i], theta[i], climb[i], radial[i], bump, 0.0, ways[i])
        for j in range(i):
            lack[i, j] = intrusion(ways[i], ways[j], steps[i] + steps[j], allowed[i, j])
            lack[j, i] = lack[i, j]
    for _ in range(most):
        worst = np.argmax(lack)
        i, j = worst // num, worst % num
        if lack[i, j] == 0.0:
            return
        a, detour = clearest(
            range_m[i],
            theta[i],
            climb[i],
            radial[i],
            bump,
            tried,
            longer,
            allowed[i],
            i,
            ways,
            steps,
            own,
        )
        b, other = clearest(
            range_m[j],
            theta[j],
            climb[j],
            radial[j],
            bump,
            tried,
            longer,
            allowed[j],
            j,
            ways,
            steps,
            own,
        )
        mover, chosen = (i, tried[detour]) if a <= b else (j, tried[other])
        if chosen == out[mover]:
            # Neither of the two has a better way: the pair is left until one of it has moved.
            lack[i, j] = lack[j, i] = 0.0
            continue
        out[mover] = chosen
        steps[mover] = trace(
            range_m[mover], theta[mover], climb[mover], radial[mover], bump, chosen, ways[mover]
        )
        for k in range(num):
            if k != mover:
                step = steps[mover] + steps[k]
                lack[mover, k] = intrusion(ways[mover], ways[k], step, allowed[mover, k])
                lack[k, mover] = lack[mover, k]
