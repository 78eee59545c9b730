"""The inequalities that a formation must obey.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, sect. IV and V.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from schemas.feasibility import Feasibility, Rule
from services.kernels.rigid import FloatArray

Drive = Literal["unicycle", "flying"]
ROUNDING = 1e-9
"""A rule that is missed by less holds: strategies go to the very limit."""


@dataclass(frozen=True)
class Limits:
    """What robots, cameras and the target allow; None is no limit."""

    beta_rad: float
    """Half the field of view that is planned with: the camera's, less the margin."""
    drive: Drive = "unicycle"
    """A unicycle carries its camera fixed; a flying camera always looks at the target."""
    target_radius_m: float = 0.0
    """R: so much about the target's centre must be in view, too."""
    v_max_mps: float | None = None
    omega_max_rps: float | None = None
    robot_radius_m: float = 0.0
    """R_r: from the camera to the outermost point of its robot."""
    robot_distance_m: float = 0.0
    """D_min: least distance between two robots' centres."""
    range_min_m: float = 0.0
    """z_min: nearer than this a camera sees nothing."""
    range_max_m: float | None = None
    margin_rad: float = 0.0
    """What is kept free of the camera's field of view for delay and noise."""
    delay_s: float = 0.0
    """tau: from the target's motion to that of the robot."""
    bearing_noise_rad: float = 0.0
    """Greatest error of a bearing that noise makes."""
    beta_up_rad: float | None = None
    """As beta, from the middle of the image upwards; None: images are high enough."""
    elevation_rad: float = 0.0
    """How far above the horizontal the centre sees a circle of cameras, which look down at it."""


@dataclass(frozen=True)
class Measures:
    """What a formation does at its worst."""

    excess_rad: float
    """The target's edge off the axis of a camera, to the left or right."""
    rise_rad: float
    """The same upwards or downwards."""
    speed_mps: float
    turning_rps: float
    error_rad: float
    """Of a bearing, by delay and noise."""
    robots_apart_m: float
    least_scale_m: float
    greatest_scale_m: float


def rules(worst: Measures, limits: Limits) -> tuple[Rule, ...]:
    """Hold what a formation does against its limits; a limit that is not set makes no rule."""
    R = limits.target_radius_m
    far_m = None if limits.range_max_m is None else limits.range_max_m - R
    near_m = limits.range_min_m + R if limits.range_min_m > 0 else 0.0
    made = (
        _at_most(
            "field of view",
            "max |beta_ri| + beta_R <= beta",
            worst.excess_rad,
            limits.beta_rad,
            "rad",
        ),
        _at_most(
            "vertical view",
            "max |gamma_ri| + gamma_R <= gamma",
            worst.rise_rad,
            limits.beta_up_rad,
            "rad",
        ),
        _at_most(
            "margin",
            "max |omega_ri| tau + v_ri tau / d + noise <= margin",
            worst.error_rad,
            limits.margin_rad if limits.delay_s > 0 or limits.bearing_noise_rad > 0 else None,
            "rad",
        ),
        _at_most("speed", "max |v_ri| <= v_max", worst.speed_mps, limits.v_max_mps, "m/s"),
        _at_most(
            "turning",
            "max |omega_ri| <= omega_max",
            worst.turning_rps,
            limits.omega_max_rps,
            "rad/s",
        ),
        _at_least(
            "robots apart",
            "min |q_i - q_j| >= D_min",
            worst.robots_apart_m,
            limits.robot_distance_m,
        ),
        _at_least(
            "target apart", "min d >= R + R_r", worst.least_scale_m, R + limits.robot_radius_m
        ),
        _at_least("near range", "min d >= z_min + R", worst.least_scale_m, near_m),
        _at_most("far range", "max d <= z_max - R", worst.greatest_scale_m, far_m, "m"),
    )
    return tuple(rule for rule in made if rule is not None)


def bearing_error(
    speed_mps: FloatArray, turning_rps: FloatArray, d_m: FloatArray, limits: Limits
) -> FloatArray:
    """Return by how much bearings are off, rad: what turns and moves meanwhile, and noise."""
    late: FloatArray = (np.abs(turning_rps) + np.abs(speed_mps) / d_m) * limits.delay_s
    return late + limits.bearing_noise_rad


def of_strategy(limits: Limits, strategy: str) -> Limits:
    """Return the limits for a strategy.

    A dome is for looking at a target piece by piece: each of its views must show the centre, not
    all of it. What keeps cameras off the target stays.
    """
    if strategy != "dome":
        return limits
    R, near_m, far_m = limits.target_radius_m, limits.range_min_m, limits.range_max_m
    return replace(
        limits,
        target_radius_m=0.0,
        robot_radius_m=limits.robot_radius_m + R,
        range_min_m=near_m + R if near_m > 0 else 0.0,
        range_max_m=None if far_m is None else far_m - R,
    )


def violated(report: Feasibility) -> tuple[str, ...]:
    """Return the names of the rules that do not hold."""
    return tuple(rule.name for rule in report.rules if not rule.holds)


def violations(report: Feasibility) -> str:
    """Write the rules that do not hold, with their numbers."""
    return "; ".join(in_words(rule) for rule in report.rules if not rule.holds)


def in_words(rule: Rule) -> str:
    """Write a rule with its numbers; angles in degrees."""
    scale, unit = {
        "rad": (180 / math.pi, "deg"),
        "rad/s": (180 / math.pi, "deg/s"),
        "m": (1.0, "m"),
        "m/s": (1.0, "m/s"),
    }[rule.unit]
    sense = rule.sense if rule.holds else {"<=": ">", ">=": "<"}[rule.sense]
    return (
        f"{rule.name}: {rule.inequality} {'holds' if rule.holds else 'is violated'}, "
        f"{rule.value * scale:.5g} {sense} {rule.limit * scale:.5g} {unit}"
    )


def _at_most(
    name: str,
    inequality: str,
    value: float,
    limit: float | None,
    unit: Literal["rad", "m", "m/s", "rad/s"],
) -> Rule | None:
    if limit is None:
        return None
    return Rule(
        name=name,
        inequality=inequality,
        sense="<=",
        value=value,
        limit=limit,
        unit=unit,
        holds=value <= limit + ROUNDING,
    )


def _at_least(name: str, inequality: str, value: float, limit: float) -> Rule | None:
    if limit == 0 or not math.isfinite(value):
        return None
    return Rule(
        name=name,
        inequality=inequality,
        sense=">=",
        value=value,
        limit=limit,
        unit="m",
        holds=value >= limit - ROUNDING,
    )
