"""Whether robots can drive a formation and their cameras keep the target in view.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, sect. IV and V.
"""

import math
from typing import TypedDict

import numpy as np

from schemas.feasibility import Feasibility, RobotNeeds
from services.kernels.rigid import FloatArray
from services.planner.known_motion import greatest_curvature
from services.planner.planar import (
    PlanarMotion,
    RobotReferences,
    Slots,
    robot_references,
    wrapped,
)
from services.planner.rules import ROUNDING, Limits, Measures, bearing_error, rules
from services.planner.scale_bounds import (
    critical_scale,
    edge_bearing,
    finite_set_scale,
    nearest_chords,
    scale_range,
)
from services.planner.tracks import Sight, Tracks, edges_off, sight_of


def check(target: PlanarMotion, slots: Slots, limits: Limits) -> Feasibility:
    """Report on a formation about a target.

    Args:
        target: one instant, or T of a whole motion.
        slots: of that instant, of those instants, or constant.
        limits: to be kept.
    """
    references = robot_references(target, slots)
    level_m = np.atleast_1d(np.asarray(slots.d_m, np.float64))
    d_m = level_m / np.cos(limits.elevation_rad)
    off, turning = _turned(references, target, slots, limits)
    sight = _seen(off, d_m[:, None], limits)
    excess, rise = edges_off(sight)
    apart = level_m * nearest_chords(np.atleast_2d(slots.theta_rad))
    held = rules(
        Measures(
            excess_rad=float(excess.max()),
            rise_rad=float(rise.max()),
            speed_mps=float(np.abs(references.v_mps).max()),
            turning_rps=float(np.abs(turning).max()),
            error_rad=float(bearing_error(references.v_mps, turning, d_m[:, None], limits).max()),
            robots_apart_m=float(apart.min()),
            least_scale_m=float(d_m.min()),
            greatest_scale_m=float(d_m.max()),
        ),
        limits,
    )
    theta, v_mps = np.atleast_2d(slots.theta_rad)[0], np.atleast_2d(references.v_mps)
    return Feasibility(
        feasible=all(rule.holds for rule in held),
        **outlook(target, slots.theta_0_rad, limits),
        robots_apart_m=_finite(float(apart.min())),
        target_apart_m=float(d_m.min()),
        rules=held,
        robots=_needs(theta, sight, v_mps, turning, limits),
    )


def check_tracks(tracks: Tracks, target: PlanarMotion, limits: Limits) -> Feasibility:
    """Report on any cameras about a target: bearings, distances and velocities are their own.

    Args:
        tracks: of N cameras at T instants, which need not follow each other.
        target: of these instants, (T,).
        limits: to be kept.
    """
    sight = sight_of(tracks, limits.target_radius_m)
    excess, rise = edges_off(sight)
    d_m, turning, apart_m = tracks.range_m, tracks.turning_rps, float(tracks.nearest_m.min())
    speed = np.linalg.norm(tracks.views.linear, axis=-1)
    reach_m = np.maximum(d_m, ROUNDING)  # A camera at the very centre is reported, too.
    held = rules(
        Measures(
            excess_rad=float(excess.max()),
            rise_rad=float(rise.max()),
            speed_mps=float(speed.max()),
            turning_rps=float(turning.max()),
            error_rad=float(bearing_error(speed, turning, reach_m, limits).max()),
            robots_apart_m=apart_m,
            least_scale_m=float(d_m.min()),
            greatest_scale_m=float(d_m.max()),
        ),
        limits,
    )
    arms = tracks.eyes_m[0] - tracks.centre_m[0]
    theta = wrapped(np.arctan2(arms[:, 1], arms[:, 0]) - np.atleast_1d(target.phi_rad)[0])
    return Feasibility(
        feasible=all(rule.holds for rule in held),
        **outlook(target, theta, limits),
        robots_apart_m=_finite(apart_m),
        target_apart_m=float(d_m.min()),
        rules=held,
        robots=_needs(theta, sight, tracks.v_mps, turning, limits),
    )


class Outlook(TypedDict):
    """What the path and the field of view allow, whatever the formation; see `Feasibility`."""

    kappa_max_1pm: float | None
    critical_scale_m: float | None
    finite_set_scale_m: float | None
    least_scale_m: float | None
    greatest_scale_m: float | None


def outlook(target: PlanarMotion, theta_0_rad: FloatArray, limits: Limits) -> Outlook:
    """Return the bounds of the scale."""
    kappa = greatest_curvature(target)
    bend, half = kappa, limits.beta_rad
    if limits.drive == "flying":  # It turns as it likes; what counts is the lower side.
        bend, half = 0.0, min(half, limits.beta_up_rad or half)
    allowed = scale_range(half, bend, limits.target_radius_m)
    return {
        "kappa_max_1pm": _finite(kappa),
        "critical_scale_m": _finite(critical_scale(limits.beta_rad, bend)),
        "finite_set_scale_m": _finite(finite_set_scale(limits.beta_rad, bend, theta_0_rad)),
        "least_scale_m": allowed and _finite(allowed[0]),
        "greatest_scale_m": allowed and _finite(allowed[1]),
    }


def _turned(
    references: RobotReferences, target: PlanarMotion, slots: Slots, limits: Limits
) -> tuple[FloatArray, FloatArray]:
    """Return (T, N) by how much a robot turns its camera off the target, and its turn rates."""
    shape = np.atleast_2d(references.x_m).shape
    if limits.drive == "unicycle":
        return np.atleast_2d(references.bearing_rad), np.broadcast_to(references.omega_rps, shape)
    # The camera turns to keep the target on its axis, at the rate of the arm.
    arm = np.atleast_1d(np.asarray(target.omega_rps))[:, None] + slots.theta_dot
    return np.zeros(shape), np.broadcast_to(arm, shape)


def _seen(off_rad: FloatArray, d_m: FloatArray, limits: Limits) -> Sight:
    """Return where cameras see the target that look down at it and are turned off it; `sight_of`.

    Args:
        off_rad: (T, N) by how much they are turned about the vertical.
        d_m: (T, 1) distance of the target's centre.
        limits: tell the elevation and the target's radius.
    """
    c, s = np.cos(limits.elevation_rad), np.sin(limits.elevation_rad)
    aside, along = c * np.sin(off_rad), c * np.cos(off_rad)
    ahead, up = c * along + s * s, s * (along - c)
    edges = (
        edge_bearing(limits.target_radius_m, d_m * np.hypot(each, ahead)) for each in (aside, up)
    )
    return Sight(np.arctan2(aside, ahead), np.arctan2(up, ahead), *edges)


def _needs(
    theta_rad: FloatArray,
    sight: Sight,
    v_mps: FloatArray,
    turning: FloatArray,
    limits: Limits,
) -> tuple[RobotNeeds, ...]:
    excess, rise = edges_off(sight)
    inside = excess <= limits.beta_rad + ROUNDING
    if limits.beta_up_rad is not None:
        inside &= rise <= limits.beta_up_rad + ROUNDING
    return tuple(
        RobotNeeds(
            theta_rad=float(theta_rad[i]),
            bearing_rad=float(np.abs(sight.bearing_rad[:, i]).max()),
            margin_rad=float(limits.beta_rad - excess[:, i].max()),
            share_in_view=float(inside[:, i].mean()),
            v_min_mps=float(v_mps[:, i].min()),
            v_max_mps=float(v_mps[:, i].max()),
            omega_rps=float(np.abs(turning[:, i]).max()),
        )
        for i in range(len(theta_rad))
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
