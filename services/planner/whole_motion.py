"""Formations for a whole motion that is known in advance, and the refusal of what cannot be."""

import math
from dataclasses import dataclass
from typing import Literal, assert_never, get_args

import numpy as np

from schemas.feasibility import Feasibility
from services.planner.errors import InfeasibleError, PlannerError
from services.planner.feasibility import check
from services.planner.known_motion import KnownMotion, greatest_curvature
from services.planner.nearest_scale import nearest_scale
from services.planner.planar import Slots
from services.planner.ring import ring_angles
from services.planner.rules import Limits, violated, violations
from services.planner.scale_bounds import greatest_target_radius, scale_range
from services.planner.strategies.adaptive_angles import adaptive_angles
from services.planner.strategies.adaptive_both import adaptive_both
from services.planner.strategies.adaptive_scale import adaptive_scale
from services.planner.strategies.constant_angles import constant_angles
from services.planner.tracks import Tracks, tracks_of

WholeStrategy = Literal[
    "circle", "adaptive_scale", "constant_angles", "adaptive_angles", "adaptive_both"
]
WHOLE: tuple[WholeStrategy, ...] = get_args(WholeStrategy)
ALPHA = 0.5
"""What an open formation is worth against even angles, unless said otherwise."""
_MM = 1e-3
_UNOPENED: dict[WholeStrategy, WholeStrategy] = {
    "adaptive_scale": "circle",
    "adaptive_both": "adaptive_angles",
}
"""These open what is feasible already; whether anything is, is seen sooner without."""


def slots_of(
    strategy: WholeStrategy,
    motion: KnownMotion,
    num_cameras: int,
    d_m: float,
    limits: Limits,
    alpha: float = ALPHA,
) -> Slots:
    """Return the places on the circle for every instant of the motion, feasible or not.

    Args:
        strategy: of the formation.
        motion: of the target.
        num_cameras: N.
        d_m: distance of the cameras from the target's centre; level or not.
        limits: to be kept.
        alpha: of adaptive_both.

    Raises:
        InfeasibleError: If the strategy has no such places.
    """
    level_m = d_m * math.cos(limits.elevation_rad)
    match strategy:
        case "circle":
            return Slots(level_m, ring_angles(num_cameras))
        case "adaptive_scale":
            return adaptive_scale(motion, num_cameras, level_m, limits)
        case "constant_angles":
            return constant_angles(motion, num_cameras, level_m, limits)
        case "adaptive_angles":
            return adaptive_angles(motion, num_cameras, level_m, limits)
        case "adaptive_both":
            return adaptive_both(motion, num_cameras, level_m, limits, alpha)
        case _:
            assert_never(strategy)


def greatest_scale(motion: KnownMotion, limits: Limits) -> float:
    """Return the greatest distance, m, at which every angle sees the target, in whole millimetres.

    Of cameras that look down it is one at which they all do: from above they see no less.

    Raises:
        InfeasibleError: If there is none: the target is too large for so tight a path.
        PlannerError: If any scale will do.
    """
    kappa = greatest_curvature(motion.target) if limits.drive == "unicycle" else 0.0
    allowed = scale_range(limits.beta_rad, kappa, limits.target_radius_m)
    if allowed is None or allowed[1] == 0:
        most = greatest_target_radius(limits.beta_rad, kappa)
        raise InfeasibleError(
            "R <= sin(beta / 2)^2 / kappa_max is violated, "
            f"{limits.target_radius_m:.4g} > {most:.4g} m; nearest feasible R = "
            f"{np.floor(most / _MM) * _MM:.3f} m"
        )
    if not np.isfinite(allowed[1]):
        raise PlannerError("nothing bounds the scale from above; say how large it shall be")
    return float(np.floor(allowed[1] / math.cos(limits.elevation_rad) / _MM) * _MM)


@dataclass(frozen=True)
class WholePlan:
    """A formation for a whole motion, and what there is to say about it."""

    strategy: str
    motion: KnownMotion
    limits: Limits
    slots: Slots | None
    """Its places on the circle; None if it is none that is planned as a circle."""
    tracks: Tracks
    report: Feasibility
    refusal: str | None
    """Why it cannot be, with the nearest feasible value; None if it can."""


def plan_whole(
    strategy: WholeStrategy,
    motion: KnownMotion,
    num_cameras: int,
    d_m: float,
    limits: Limits,
    alpha: float = ALPHA,
) -> WholePlan:
    """Plan a formation for a whole motion and report on it; see `slots_of`.

    Raises:
        InfeasibleError: If the strategy has no such formation, not even a bad one; with the
            nearest scale at which it has.
    """
    asked = (strategy, motion, num_cameras, d_m, limits)
    try:
        slots = slots_of(*asked, alpha)
    except InfeasibleError as error:
        raise InfeasibleError(f"{error}; {_nearest_in_words(*asked)}") from error
    report, refusal = check(motion.target, slots, limits), None
    if not report.feasible:
        nearest = [_nearest_in_words(*asked)]
        if "robots apart" in violated(report) and (most := _most_cameras(*asked)):
            nearest.append(f"or N = {most}")
        refusal = (
            f"{strategy}, N = {num_cameras}, d = {d_m:g} m: {violations(report)}; "
            f"{' '.join(nearest)}"
        )
    tracks = tracks_of(motion, slots, limits)
    return WholePlan(strategy, motion, limits, slots, tracks, report, refusal)


def nearest_of(
    strategy: WholeStrategy, motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits
) -> float | None:
    """Return the feasible scale, m, nearest to one that is not, if there is any."""
    sooner = _UNOPENED.get(strategy, strategy)

    def holds(scale_m: float) -> bool:
        return _is_feasible(sooner, motion, num_cameras, scale_m, limits)

    if sooner == "adaptive_angles":  # It takes long for every scale; fewer are tried.
        return nearest_scale(holds, d_m, resolution_m=0.01, ratio=1.25)
    return nearest_scale(holds, d_m)


def _is_feasible(
    strategy: WholeStrategy, motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits
) -> bool:
    try:
        slots = slots_of(strategy, motion, num_cameras, d_m, limits)
    except InfeasibleError:
        return False
    return check(motion.target, slots, limits).feasible


def _most_cameras(
    strategy: WholeStrategy, motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits
) -> int | None:
    """Return how many have room at this scale, if any do."""
    sooner = _UNOPENED.get(strategy, strategy)
    fewer = range(num_cameras - 1, 0, -1)
    return next((n for n in fewer if _is_feasible(sooner, motion, n, d_m, limits)), None)


def _nearest_in_words(
    strategy: WholeStrategy, motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits
) -> str:
    nearest = nearest_of(strategy, motion, num_cameras, d_m, limits)
    if nearest is not None:
        return f"nearest feasible d = {nearest:.3f} m"
    try:
        greatest_scale(motion, limits)
    except InfeasibleError as error:
        return f"no d is feasible: {error}"
    except PlannerError:
        pass  # Any scale would be seen; it is another limit that forbids it.
    return "no d is feasible, the limit itself must give way"
