"""A plan in words and numbers, for people and for machines."""

import json
import math
from collections.abc import Iterator

import numpy as np
from rich.console import Console

from services.kernels.rigid import FloatArray
from services.planner.planar import wrapped
from services.planner.rules import in_words
from services.planner.whole_motion import WholePlan


def as_json(plan: WholePlan) -> str:
    """Return the report as JSON: SI units and radians, as the names say."""
    scales = plan.tracks.range_m
    facts = {
        "strategy": plan.strategy,
        "cameras": len(plan.report.robots),
        "drive": plan.limits.drive,
        "beta_rad": plan.limits.beta_rad,
        "scale_m": [float(scales.min()), float(scales.max())],
        "refusal": plan.refusal,
    }
    return json.dumps(facts | plan.report.model_dump(mode="json"), indent=2)


def show(plan: WholePlan, console: Console) -> None:
    """Print the report."""
    for line in _summary(plan):
        console.print(line)
    for line in _robots(plan):
        console.print(line)
    for rule in plan.report.rules:
        console.print(f"  {'ok' if rule.holds else '!!'}  {in_words(rule)}")
    console.print()
    console.print(f"infeasible: {plan.refusal}" if plan.refusal else "feasible")


def _summary(plan: WholePlan) -> Iterator[str]:
    report, limits = plan.report, plan.limits
    scales = plan.tracks.range_m
    d = _span(float(scales.min()), float(scales.max()), "m")
    yield f"{plan.strategy}, N = {len(report.robots)}, d = {d}, {limits.drive}"
    kappa = report.kappa_max_1pm
    yield (
        f"  kappa_max {'unbounded' if kappa is None else f'{kappa:.4f} 1/m'}, "
        f"beta {math.degrees(limits.beta_rad):.2f} deg, R {limits.target_radius_m:g} m"
    )
    if report.critical_scale_m is None or report.finite_set_scale_m is None:
        yield "  d_c: the field of view does not bound the distance from above"
    else:
        yield (
            f"  d_c {report.critical_scale_m:.3f} m for any angles, "
            f"{report.finite_set_scale_m:.3f} m for these even ones"
        )
    if report.least_scale_m is None:
        yield "  no scale lets every angle see the whole target"
    else:
        top = report.greatest_scale_m
        upwards = "upwards" if top is None else f"to {top:.3f} m"
        yield (
            "  every angle sees the whole target at d from "
            f"{report.least_scale_m:.3f} m {upwards}, seen from above"
        )
    if report.robots_apart_m is not None:
        yield f"  least distance between robots {report.robots_apart_m:.3f} m"
    yield f"  least distance to the target's centre {report.target_apart_m:.3f} m"


def _robots(plan: WholePlan) -> Iterator[str]:
    row = "{:>20}{:>10}{:>10}{:>10}{:>18}{:>14}".format
    yield row("theta, deg", "bearing", "margin", "in view", "v, m/s", "omega, deg/s")
    thetas = np.degrees(_places(plan))
    for index, robot in enumerate(plan.report.robots):
        yield row(
            _span(float(thetas[:, index].min()), float(thetas[:, index].max()), ""),
            f"{math.degrees(robot.bearing_rad):.2f}",
            f"{math.degrees(robot.margin_rad):.2f}",
            f"{100 * robot.share_in_view:.1f} %",
            _span(robot.v_min_mps, robot.v_max_mps, ""),
            f"{math.degrees(robot.omega_rps):.2f}",
        )


def _places(plan: WholePlan) -> FloatArray:
    """Return (T, N) angles on the circle, or (1, N), without jumps."""
    if plan.slots is not None:
        return np.atleast_2d(plan.slots.theta_rad)
    arms = plan.tracks.eyes_m - plan.tracks.centre_m[:, None]
    phi = np.asarray(plan.motion.target.phi_rad)[:, None]
    return np.unwrap(wrapped(np.arctan2(arms[..., 1], arms[..., 0]) - phi), axis=0)


def _span(low: float, high: float, unit: str) -> str:
    text = f"{low:.3f}" if high - low < 5e-4 else f"{low:.3f} .. {high:.3f}"
    return f"{text} {unit}".strip()
