"""The closed rules of cameras on a circle about a target, over many courses of angles or scales.

A course is a row of a table (2, C, K, 5): values and rates at the K instants of a horizon in terms
of what is known of each quantity, (5, M); see `planner/horizon.py`. The target moves at (K,) `v`,
`omega`. A rule is broken by so much, about rad, divided by the target's speed or `slowest`.
"""

import numpy as np
from numba import njit

LATE = 1e3
"""Who must break a rule for a while shall keep it in the end: this is added, 1 otherwise."""


@njit(cache=True, error_model="numpy", nogil=True)
def _off_view(theta_dot, off, d, v, omega, views, slowest):  # type: ignore[no-untyped-def]
    """Return how far one looks beyond its view b: |arg w| <= b, w = z e^(-j off).

    Args:
        off: theta - theta_0.
        views: sin(b), cos(b), cos(theta_0 - b), cos(theta_0 + b).
        theta_dot, d, v, omega, slowest: as below.
    """
    ahead = abs(v)
    swing = d * (omega + theta_dot)
    if v < 0:
        swing = -swing
    sine, cosine = np.sin(off), np.cos(off)
    up, across = ahead * cosine * views[0], ahead * sine * views[1]
    left = swing * views[2] - across - up
    right = across - up - swing * views[3]
    return max(left, right) / max(ahead, slowest)


@njit(cache=True, error_model="numpy", nogil=True)
def _views(theta_0, view):  # type: ignore[no-untyped-def]
    return np.sin(view), np.cos(view), np.cos(theta_0 - view), np.cos(theta_0 + view)


@njit(cache=True, error_model="numpy", nogil=True)
def _off_scale(d, d_dot, v, omega, bounds, num, slowest):  # type: ignore[no-untyped-def]
    """Return how far a regular polygon breaks what bounds it; see `regular_excess`.

    |arg(v + s e^(j theta))| <= b with s = d' + j d omega is, for both signs,
    |s| cos(arg s + theta -+ (b + pi / 2)) <= v sin(b). The greatest cosine over the polygon is that
    of the angle to the nearest corner, so that the number of cameras costs nothing.
    """
    floor, most, v_max, beta, target_radius = bounds
    excess = max(floor - d, d - most)
    swing = np.hypot(d_dot, d * omega)
    ahead = abs(v)
    excess = max(excess, ahead + swing - v_max)
    if beta < np.inf:
        edge = np.arcsin(min(target_radius / max(d, 1e-6), 1.0))
        view = beta - edge
        angle = np.arctan2(d * omega, d_dot)
        if v < 0:
            angle += np.pi
        step = 2.0 * np.pi / num
        worst = -1.0
        for side in (1.0, -1.0):
            off = angle + np.pi - side * (view + np.pi / 2.0)  # From the corner at pi.
            worst = max(worst, np.cos(off - step * np.rint(off / step)))
        excess = max(excess, (swing * worst - ahead * np.sin(view)) / max(ahead, slowest))
    return excess


@njit(cache=True, error_model="numpy", nogil=True)
def hold_angles(theta, theta_dot, theta_0, d, v, omega, view, slowest, excess):  # type: ignore[no-untyped-def]
    """Write how far each of M robots looks off at each of K instants.

    Args:
        theta, theta_dot: (K, M) rad, rad/s.
        theta_0: (M,) for which cameras are mounted.
        d, view: scale, m, and half of what they see, rad.
        v, omega, slowest: as above.
        excess: (K, M); written.
    """
    for m in range(theta.shape[1]):
        views = _views(theta_0[m], view)
        for k in range(theta.shape[0]):
            off = theta[k, m] - theta_0[m]
            excess[k, m] = _off_view(theta_dot[k, m], off, d, v[k], omega[k], views, slowest)


@njit(cache=True, error_model="numpy", nogil=True)
def hold_scale(d, d_dot, v, omega, bounds, num, slowest, excess):  # type: ignore[no-untyped-def]
    """Write how far a scale breaks what bounds it at each of K instants.

    Args:
        d, d_dot: (K, 1) m, m/s.
        v, omega, slowest: as above.
        bounds: least and greatest scale, m, greatest speed, m/s, half of what cameras see, rad, or
            infinite if they turn to the target by themselves, and the target's radius, m.
        num: N; theta_i = pi (2 i / N - 1).
        excess: (K, 1); written.
    """
    for k in range(d.shape[0]):
        excess[k, 0] = _off_scale(d[k, 0], d_dot[k, 0], v[k], omega[k], bounds, num, slowest)


@njit(cache=True, error_model="numpy", nogil=True)
def rate_angles(  # type: ignore[no-untyped-def]
    table, known, wished, theta_0, d, v, omega, view, slowest, allowed, least, worth, fault
):
    """Write what each course of each of M robots is worth, and how far it breaks the rule.

    Args:
        table, known, v, omega, slowest: as above.
        wished: (M,) angles, the nearer the better.
        theta_0, d, view: as in `hold_angles`.
        allowed: (K, M) what may be broken.
        least: (M,) a course that is not worth more is not looked at; nan: all are.
        worth: (C, M); written.
        fault: (C, M) 0 if the rule is kept; infinite if the course was not looked at, or is broken
            and need not be taken, as another or the former one keeps the rule; written.
    """
    num_courses, num_steps = table.shape[1], table.shape[2]
    theta = np.empty(num_steps)
    for m in range(known.shape[1]):
        a, b, c, s, i = known[:, m]
        enough, views = not np.isnan(least[m]), _views(theta_0[m], view)
        for course in range(num_courses):
            far = 0.0
            for k in range(num_steps):
                at = table[0, course, k]
                theta[k] = at[0] * a + at[1] * b + at[2] * c + at[3] * s + at[4] * i
                far += abs(theta[k] - wished[m])
            worth[course, m], fault[course, m] = -far / num_steps, np.inf
            if worth[course, m] <= least[m]:
                continue
            total, late = 0.0, 1.0
            for k in range(num_steps):
                by = table[1, course, k]
                theta_dot = by[0] * a + by[1] * b + by[2] * c + by[3] * s + by[4] * i
                off = theta[k] - theta_0[m]
                over = _off_view(theta_dot, off, d, v[k], omega[k], views, slowest) - allowed[k, m]
                if over > 0.0:
                    total += over
                    if enough:
                        break
                    if k == num_steps - 1:
                        late = LATE
            if total == 0.0:
                fault[course, m], enough = 0.0, True
            elif not enough:
                fault[course, m] = late + total / num_steps


@njit(cache=True, error_model="numpy", nogil=True)
def rate_scale(  # type: ignore[no-untyped-def]
    table, known, v, omega, bounds, num, slowest, allowed, least, worth, fault
):
    """Write what each course of a scale is worth, the wider the more, and how far it breaks rules.

    Args:
        table, known, v, omega, slowest: as above.
        bounds, num: as in `hold_scale`.
        allowed, least, worth, fault: as in `rate_angles`; M is 1.
    """
    num_courses, num_steps = table.shape[1], table.shape[2]
    a, b, c, s, i = known[:, 0]
    enough = not np.isnan(least[0])
    scale = np.empty(num_steps)
    for course in range(num_courses):
        wide = 0.0
        for k in range(num_steps):
            at = table[0, course, k]
            scale[k] = at[0] * a + at[1] * b + at[2] * c + at[3] * s + at[4] * i
            wide += scale[k]
        worth[course, 0], fault[course, 0] = wide / num_steps, np.inf
        if worth[course, 0] <= least[0]:
            continue
        total, late = 0.0, 1.0
        for k in range(num_steps):
            by = table[1, course, k]
            d_dot = by[0] * a + by[1] * b + by[2] * c + by[3] * s + by[4] * i
            over = _off_scale(scale[k], d_dot, v[k], omega[k], bounds, num, slowest) - allowed[k, 0]
            if over > 0.0:
                total += over
                if enough:
                    break
                if k == num_steps - 1:
                    late = LATE
        if total == 0.0:
            fault[course, 0], enough = 0.0, True
        elif not enough:
            fault[course, 0] = late + total / num_steps
