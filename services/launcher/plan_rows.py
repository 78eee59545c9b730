"""What a plan asks over time: bearings, distances, angles, speeds, turn rates, row by row."""

from collections.abc import Callable
from typing import Any

import numpy as np

from services.kernels.rigid import FloatArray
from services.launcher.plan_style import GRID, INK, TARGET, colour
from services.planner.planar import wrapped
from services.planner.tracks import Sight, sight_of
from services.planner.whole_motion import WholePlan

_NOTICED_RAD = np.radians(0.5)
"""Angles that stay below are not worth a row."""
_LEFT: dict[str, Any] = {
    "textcoords": "offset points",
    "color": INK,
    "fontsize": 9,
    "ha": "left",
    "va": "center",
}

Row = Callable[[Any, WholePlan, Sight], None]


def draw_rows(figure: Any, plan: WholePlan) -> None:
    """Draw the rows below each other, over the same time."""
    sight = sight_of(plan.tracks, plan.limits.target_radius_m)
    wanted: list[Row] = [_draw_bearings]
    if np.abs(sight.rise_rad).max() > _NOTICED_RAD:
        wanted.append(_draw_rises)
    wanted.append(_draw_distances)
    if np.abs(_moves(plan)).max() > _NOTICED_RAD:
        wanted.append(_draw_moves)
    wanted += [_draw_speeds, _draw_turning]
    rows = figure.subplots(len(wanted), 1, sharex=True)
    for axes, draw in zip(rows, wanted, strict=True):
        draw(axes, plan, sight)
        tidy(axes)
    rows[-1].set_xlabel("time, s", color=INK)
    figure.align_ylabels(rows)


def tidy(axes: Any) -> None:
    """Take away what is no data."""
    axes.grid(color=GRID, lw=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, length=0)
    for side in axes.spines.values():
        side.set_visible(False)


def _draw_bearings(axes: Any, plan: WholePlan, sight: Sight) -> None:
    room = np.degrees(plan.limits.beta_rad - sight.edge_rad.max(axis=1))
    sized = plan.limits.target_radius_m > 0
    _draw_angles(axes, plan, np.degrees(sight.bearing_rad), room, r"\beta", sized=sized)
    axes.set_ylabel("bearing of\ntarget, deg", color=INK)


def _draw_rises(axes: Any, plan: WholePlan, sight: Sight) -> None:
    room = None
    if plan.limits.beta_up_rad is not None:
        room = np.degrees(plan.limits.beta_up_rad - sight.edge_up_rad.max(axis=1))
    sized = plan.limits.target_radius_m > 0
    _draw_angles(axes, plan, np.degrees(sight.rise_rad), room, r"\gamma", sized=sized)
    axes.set_ylabel("target above\naxis, deg", color=INK)


def _draw_angles(
    axes: Any,
    plan: WholePlan,
    angles: FloatArray,
    room: FloatArray | None,
    sign: str,
    *,
    sized: bool,
) -> None:
    """Draw angles of all cameras between their bounds."""
    _draw_each(axes, plan, angles)
    if room is None:
        return
    name = f"{sign} - {sign}_R" if sized else sign
    for side, bound in ((1, name), (-1, f"-({name})" if sized else f"-{name}")):
        axes.plot(plan.motion.t_s, side * room, color=INK, lw=1.0, ls="--")
        axes.annotate(f"${bound}$", (plan.motion.t_s[-1], side * room[-1]), (4, 0), **_LEFT)
    axes.margins(y=0.12)


def _draw_distances(axes: Any, plan: WholePlan, sight: Sight) -> None:  # noqa: ARG001
    t_s, nearest_m = plan.motion.t_s, plan.tracks.nearest_m
    ranges_m = plan.tracks.range_m
    alike = np.ptp(ranges_m, axis=1).max() < 1e-6
    _draw_each(axes, plan, ranges_m[:, :1] if alike else ranges_m, TARGET if alike else None)
    top, last_m = float(ranges_m.max()), float(ranges_m[-1].mean())
    axes.annotate("to target", (t_s[-1], last_m), (4, 0), **_LEFT)
    if np.isfinite(nearest_m).all():
        top = max(top, float(nearest_m.max()))
        axes.plot(t_s, nearest_m, color=INK, lw=1.2, ls="-.")
        below = -12 if abs(nearest_m[-1] - last_m) < 0.1 * top else 0
        axes.annotate("of nearest two", (t_s[-1], nearest_m[-1]), (4, below), **_LEFT)
    critical = plan.report.critical_scale_m
    if critical is not None and plan.slots is not None:
        level_m = critical / np.cos(plan.limits.elevation_rad)
        axes.plot(t_s[[0, -1]], [level_m, level_m], color=INK, lw=1.0, ls="--")
        axes.annotate(r"$d_c$", (t_s[0], level_m), (2, 2), **_LEFT | {"va": "bottom"})
        top = max(top, level_m)
    axes.set_ylim(0, 1.15 * top)
    axes.set_ylabel("distance, m", color=INK)


def _draw_moves(axes: Any, plan: WholePlan, sight: Sight) -> None:  # noqa: ARG001
    moves = np.degrees(_moves(plan))
    _draw_each(axes, plan, np.broadcast_to(moves, (len(plan.motion.t_s), moves.shape[-1])))
    axes.margins(y=0.12)
    axes.set_ylabel("θ off the even\nangle, deg", color=INK)


def _draw_speeds(axes: Any, plan: WholePlan, sight: Sight) -> None:  # noqa: ARG001
    t_s, target = plan.motion.t_s, plan.motion.target
    _draw_each(axes, plan, plan.tracks.v_mps)
    axes.plot(t_s, np.broadcast_to(target.v_mps, t_s.shape), color=TARGET, lw=1.4, ls="--")
    _draw_limit(axes, plan, plan.limits.v_max_mps, r"$v_{max}$", float(plan.tracks.v_mps.max()))
    axes.set_ylabel("speed, m/s", color=INK)


def _draw_turning(axes: Any, plan: WholePlan, sight: Sight) -> None:  # noqa: ARG001
    t_s, target = plan.motion.t_s, plan.motion.target
    rates = np.degrees(plan.tracks.views.angular)
    # About the vertical, with its sense, if it is about nothing else.
    level = np.abs(rates[..., :2]).max() < 1e-6
    turning = rates[..., 2] if level else np.degrees(plan.tracks.turning_rps)
    _draw_each(axes, plan, turning)
    omega = np.degrees(np.broadcast_to(target.omega_rps, t_s.shape))
    axes.plot(t_s, omega if level else np.abs(omega), color=TARGET, lw=1.4, ls="--")
    limit = plan.limits.omega_max_rps
    most = None if limit is None else float(np.degrees(limit))
    _draw_limit(axes, plan, most, r"$\omega_{max}$", float(np.abs(turning).max()))
    axes.set_ylabel("turn rate,\ndeg/s", color=INK)


def _draw_limit(
    axes: Any, plan: WholePlan, limit: float | None, name: str, greatest: float
) -> None:
    """Draw a limit, unless it is so far away that it would flatten all else."""
    if limit is not None and limit < 2.5 * greatest:
        axes.plot(plan.motion.t_s[[0, -1]], [limit, limit], color=INK, lw=1.0, ls=":")
        axes.annotate(name, (plan.motion.t_s[-1], limit), (4, 0), **_LEFT)


def _draw_each(axes: Any, plan: WholePlan, values: FloatArray, ink: str | None = None) -> None:
    for i in range(values.shape[1]):
        axes.plot(plan.motion.t_s, values[:, i], color=ink or colour(i), lw=1.4)


def _moves(plan: WholePlan) -> FloatArray:
    """Return (T, N) or (N,) by how much robots are off the even angles, rad."""
    if plan.slots is None:
        return np.zeros(1)
    return wrapped(plan.slots.theta_rad - plan.slots.theta_0_rad)
