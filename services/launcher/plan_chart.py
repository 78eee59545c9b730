"""A plan as a picture: the formation along the path, and what it asks of robots and cameras.

After Fig. 3 and 7 of Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020.
"""

from pathlib import Path
from typing import Any

import numpy as np

from services.launcher.plan_rows import draw_rows, tidy
from services.launcher.plan_style import INK, TARGET, colour
from services.planner.rules import violated
from services.planner.tracks import sight_of
from services.planner.whole_motion import WholePlan

_ARROW = ((-0.6, -0.45), (1.0, 0.0), (-0.6, 0.45), (-0.3, 0.0), (-0.6, -0.45))
_WEDGE = 1.25
"""Length of a field of view, in distances to the target."""
_ROOM = 2.6
"""Formations are drawn so many radii of theirs apart, that they do not cover each other."""
_MOST_SHOWN = 6
_NAMED = 12
"""More robots than this have no names in the legend."""
_SAME_HEIGHT_M = 0.01
"""Cameras whose heights differ by less are the corners of a polygon."""


def draw(plan: WholePlan, path: Path) -> None:
    """Draw path, formations and fields of view, and bearings, scale, angles and speeds over time.

    Raises:
        ImportError: If matplotlib is not installed.
        OSError: If the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 9.5), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = np.asarray(figure.subfigures(1, 2, width_ratios=(1.2, 1)))
    ground, closely = left.subplots(2, 1)
    _draw_ground(ground, plan)
    _draw_closely(closely, plan)
    for axes in (ground, closely):
        tidy(axes)
    draw_rows(right, plan)
    _write_title(figure, plan)
    lines, names = ground.get_legend_handles_labels()
    figure.legend(
        lines,
        names,
        loc="outside lower left",
        ncols=min(len(names), 9),
        columnspacing=1.4,
        frameon=False,
        labelcolor=INK,
    )
    figure.savefig(path, dpi=110)


def _write_title(figure: Any, plan: WholePlan) -> None:
    scales = plan.tracks.range_m
    span = f"{scales.min():.2f}" + (f" to {scales.max():.2f}" if np.ptp(scales) > 5e-3 else "")
    broken = ", ".join(violated(plan.report))
    figure.suptitle(
        f"{plan.strategy}, N = {len(plan.report.robots)}, d = {span} m, {plan.limits.drive}: "
        + ("feasible" if plan.report.feasible else f"infeasible ({broken})"),
        x=0.01,
        ha="left",
        color=INK,
        fontsize=13,
        fontweight="bold",
    )


def _draw_ground(axes: Any, plan: WholePlan) -> None:
    """Draw the paths, and the formation with its fields of view at some instants."""
    eyes, target = plan.tracks.eyes_m, plan.motion.target
    num = eyes.shape[1]
    for i in range(num):
        name = f"robot {i + 1}" if num <= _NAMED else None
        axes.plot(*eyes[:, i, :2].T, color=colour(i), lw=0.9, label=name)
    axes.plot(target.x_m, target.y_m, color=TARGET, lw=1.6, ls="--", label="target")
    for k in _shown(plan):
        _draw_formation(axes, plan, k, 9)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("paths from above", loc="left", color=INK, fontsize=10)
    axes.set_ylabel("y, m", color=INK)


def _draw_closely(axes: Any, plan: WholePlan) -> None:
    """Draw the instant at which a camera sees the target farthest off its axis."""
    k, what = _worst(plan)
    _draw_formation(axes, plan, k, 16)
    axes.set_aspect("equal", adjustable="datalim")
    title = f"fields of view at {plan.motion.t_s[k]:.1f} s: {what}"
    axes.set_title(title, loc="left", color=INK, fontsize=10)
    axes.set_xlabel("x, m", color=INK)
    axes.set_ylabel("y, m", color=INK)


def _worst(plan: WholePlan) -> tuple[int, str]:
    """Return the instant that asks most of a camera, and why."""
    sight = sight_of(plan.tracks, 0.0)
    off = np.maximum(np.abs(sight.bearing_rad), np.abs(sight.rise_rad)).max(axis=1)
    if off.max() > np.radians(0.5):
        return int(off.argmax()), "the target is farthest off an axis"
    return int(plan.tracks.turning_rps.max(axis=1).argmax()), "a camera turns fastest"


def _draw_formation(axes: Any, plan: WholePlan, k: int, size: float) -> None:
    """Draw polygon, fields of view, robots and target of the k-th instant."""
    tracks, target = plan.tracks, plan.motion.target
    eyes, centre = tracks.eyes_m[k], tracks.centre_m[k, :2]
    arms = eyes[:, :2] - centre
    if np.ptp(eyes[:, 2]) < _SAME_HEIGHT_M:
        around = np.argsort(np.arctan2(arms[:, 1], arms[:, 0]))
        axes.fill(*eyes[around, :2].T, fill=False, ec=INK, lw=1.0, zorder=3)
    else:
        for eye in eyes:
            axes.plot(*np.stack([eye[:2], centre]).T, color=INK, lw=0.6, zorder=3)
    ahead = tracks.views.T[k, :, :2, 2]
    for i, (eye, gaze) in enumerate(zip(eyes[:, :2], ahead, strict=True)):
        # The sides of a tilted view are farther apart on the ground.
        half = np.arctan2(np.tan(plan.limits.beta_rad), np.hypot(*gaze))
        sides = np.arctan2(gaze[1], gaze[0]) + half * np.linspace(-1, 1, 17)
        reach = _WEDGE * np.linalg.norm(arms[i])
        fan = eye + reach * np.stack([np.cos(sides), np.sin(sides)], axis=1)
        axes.fill(*np.vstack([eye, fan]).T, color=colour(i), alpha=0.16, lw=0, zorder=1)
        _draw_arrow(axes, eye, float(tracks.heading_rad[k, i]), colour(i), size)
    here = float(np.asarray(target.x_m)[k]), float(np.asarray(target.y_m)[k])
    _draw_arrow(axes, here, float(np.asarray(target.phi_rad)[k]), TARGET, size)
    if plan.limits.target_radius_m > 0:
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 65)) * plan.limits.target_radius_m
        axes.plot(here[0] + circle.real, here[1] + circle.imag, color=TARGET, lw=0.8)


def _draw_arrow(axes: Any, place: Any, phi_rad: float, ink: str, size: float) -> None:
    from matplotlib.markers import MarkerStyle
    from matplotlib.transforms import Affine2D

    marker = MarkerStyle(_ARROW, transform=Affine2D().rotate(phi_rad))
    axes.plot(*place, marker=marker, ms=size, color=ink, mec="white", mew=0.5, zorder=4)


def _shown(plan: WholePlan) -> list[int]:
    """Return instants whose formations are as evenly along the path as they have room."""
    target, num = plan.motion.target, len(plan.motion.t_s)
    steps = np.hypot(np.diff(np.asarray(target.x_m)), np.diff(np.asarray(target.y_m)))
    way = np.concatenate([[0.0], np.cumsum(steps)])
    arms = plan.tracks.eyes_m[..., :2] - plan.tracks.centre_m[:, None, :2]
    room = _ROOM * float(np.linalg.norm(arms, axis=-1).max())
    count = int(np.clip(way[-1] // room, 1, _MOST_SHOWN))
    places = way[-1] * np.arange(count) / count
    return [int(k) for k in np.minimum(np.searchsorted(way, places), num - 1)]
