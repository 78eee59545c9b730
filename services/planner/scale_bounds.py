"""Which scales and angles keep the target in view: closed forms.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, sect. IV; the numbers of equations
are the article's. The bounds hold for robots that cannot step aside (unicycles) with cameras
fixed on them.
"""

import numpy as np

from services.kernels.rigid import FloatArray

ScaleRange = tuple[float, float]
"""Least and greatest distance from the target, m; the greatest may be infinite."""
_STRAIGHT = 1e-12
"""Of a path that bends less, 1/m, no scale is the greatest."""
_TOUCHING = 1e-9
"""Scales may miss the tightest condition by so much of rounding."""


def critical_scale(beta_rad: float, kappa_max: float) -> float:
    """Return d_c, m: up to it every angle on the circle sees the target's centre.

    d_c = sin(beta) / kappa_max; on a straight line any scale will do.
    """
    return float(np.sin(beta_rad)) / kappa_max if kappa_max > 0 else np.inf


def finite_set_scale(beta_rad: float, kappa_max: float, theta_0_rad: FloatArray) -> float:
    """Return the greatest scale, m, at which these N angles see the target's centre.

    min over i and both signs of |sin(beta) / (kappa_max cos(+-beta - theta_0i))|.
    """
    worst = max(np.abs(np.cos(sign * beta_rad - theta_0_rad)).max() for sign in (1, -1))
    return critical_scale(beta_rad, kappa_max) / float(worst)


def scale_range(beta_rad: float, kappa_max: float, target_radius_m: float) -> ScaleRange | None:
    """Return the scales at which every angle sees a whole target of this radius, if any.

    The target's edge is beta_R = arcsin(R / d) off its centre, hence
    arcsin(d kappa_max) + arcsin(R / d) <= beta; it has solutions if and only if
    R kappa_max <= sin(beta / 2)^2. With a and b the two arcs, sin a sin b = R kappa_max tells
    cos(a - b), which gives a and so d.
    """
    if kappa_max < _STRAIGHT:
        return target_radius_m / float(np.sin(beta_rad)), np.inf
    if target_radius_m == 0:
        return 0.0, critical_scale(beta_rad, kappa_max)
    inner = float(np.cos(beta_rad)) + 2 * target_radius_m * kappa_max
    if inner > 1 + _TOUCHING:
        return None
    spread = float(np.arccos(min(inner, 1.0)))
    least, greatest = (np.sin((beta_rad + s * spread) / 2) / kappa_max for s in (-1, 1))
    return float(least), float(greatest)


def greatest_target_radius(beta_rad: float, kappa_max: float) -> float:
    """Return the greatest R, m, for which some scale lets every angle see the whole target."""
    return float(np.sin(beta_rad / 2)) ** 2 / kappa_max if kappa_max > 0 else np.inf


def edge_bearing(target_radius_m: float, d_m: float | FloatArray) -> FloatArray:
    """Return beta_R, rad: how far the target's edge is off its centre; pi/2 from within."""
    ratio = target_radius_m / np.asarray(d_m, np.float64)
    edge: FloatArray = np.arcsin(np.minimum(ratio, 1.0))
    return edge


def separation_scale(min_distance_m: float, theta_rad: FloatArray) -> float:
    """Return the least scale, m, at which robots on these angles are so far apart.

    D_min / (2 sin(gap / 2)) with the smallest gap between two angles.
    """
    chord = chord_per_scale(theta_rad)
    if min_distance_m == 0:
        return 0.0
    return min_distance_m / chord if chord > 0 else np.inf


def chord_per_scale(theta_rad: FloatArray) -> float:
    """Return the distance of the nearest two of N robots at scale 1; infinite for one robot."""
    return float(nearest_chords(theta_rad[None, :])[0])


def nearest_chords(theta_rad: FloatArray) -> FloatArray:
    """Return (T,) the distance of the nearest two robots at scale 1, from (T, N) angles."""
    places = np.sort(np.mod(theta_rad, 2 * np.pi), axis=1)
    if places.shape[1] < 2:
        return np.full(len(places), np.inf)
    gaps = np.diff(places, axis=1, append=places[:, :1] + 2 * np.pi)
    chords: FloatArray = 2 * np.sin(np.minimum(gaps.min(axis=1), np.pi) / 2)
    return chords


def angle_bounds(
    d_m: float, kappa: FloatArray, beta_rad: float, theta_0_rad: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper angles (N,) between which every robot sees the target always.

    At prescribed scale: the greatest lower and the least upper one of all instants; see
    `angle_corridor`.
    """
    lower, upper = angle_corridor(d_m, kappa, beta_rad, theta_0_rad)
    return lower.max(axis=0), upper.min(axis=0)


def angle_corridor(
    d_m: float | FloatArray,
    kappa: FloatArray,
    beta_rad: float | FloatArray,
    theta_0_rad: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper angles (T, N) between which robots see the target in each turn.

    theta(t) = theta_0 -+ beta + arcsin(d kappa_s(t) cos(theta_0 -+ beta)), for a scale and angles
    that do not change. NaN where no angle would do, i.e. where
    v^2 < d^2 omega^2 cos(theta_0 -+ beta)^2, eq. (32).

    Args:
        d_m: the scale, or (T,).
        kappa: (T,) signed curvature of the target's path, 1/m.
        beta_rad: half the field of view, or (T,).
        theta_0_rad: (N,) angles for which the cameras are mounted.
    """
    bend = np.asarray(d_m * kappa)[:, None]
    half = np.broadcast_to(beta_rad, kappa.shape)[:, None]

    def bound(side: int) -> FloatArray:
        reach = bend * np.cos(theta_0_rad + side * half)
        lost = (np.abs(reach) > 1) | ~np.isfinite(reach)
        angles: FloatArray = theta_0_rad + side * half + np.arcsin(np.where(lost, np.nan, reach))
        return angles

    return bound(-1), bound(1)
