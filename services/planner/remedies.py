"""What would do instead of a formation that cannot be: the nearest feasible values."""

import math
import time
from collections.abc import Callable, Collection, Iterator
from typing import Any

from schemas.feasibility import Feasibility
from services.planner.errors import PlannerError
from services.planner.formation import FormationSettings
from services.planner.nearest_scale import nearest_scale
from services.planner.rules import Limits, violated, violations
from services.planner.scale_bounds import greatest_target_radius

Judge = Callable[[FormationSettings], Feasibility]
"""Reports on a formation; raises PlannerError for one that cannot even be had."""

_SIZELESS = ("dome",)
"""What places the cameras of these is no radius."""
_PACES = {"orbit": "orbit_deg_s", "random": "redraw_s", "dome": "travel_s"}
"""What sets the speed of cameras that move about the target."""
_RATIO = 1.2
"""Of the values that are tried: each may ask for a whole motion."""
_PACE_RATIO = 2.0
"""The same of paces: what is slow enough stays so however much slower."""


def refusal(
    formation: FormationSettings,
    report: Feasibility,
    limits: Limits,
    judge: Judge,
    asked: Collection[str] = (),
    work_s: float = math.inf,
) -> str:
    """Say why a formation is refused: inequalities, both of their sides, and what would do.

    Args:
        formation: that is infeasible.
        report: on it.
        limits: that it was held against.
        judge: of other formations.
        asked: names of the settings that were to be changed; their remedies come first.
        work_s: processor time after which no other values are tried.
    """
    end_s = time.thread_time() + work_s

    def may_go_on() -> bool:
        return time.thread_time() < end_s

    told = f"{formation.strategy}, N = {formation.cameras}, drive {formation.drive}"
    if formation.strategy not in _SIZELESS:
        told += f", radius_m = {formation.radius_m:g}"
    remedies = _remedies(formation, report, judge, may_go_on)
    known = sorted(remedies, key=lambda each: each[0] not in asked)
    if known:
        would_do = "nearest feasible " + " or ".join(f"{name} = {value}" for name, value in known)
        would_do += "" if may_go_on() else " (not searched further)"
    elif not may_go_on():
        would_do = "no feasible value found in time (not searched further)"
    else:
        would_do = "nothing near it is feasible, a limit must give way"
    return "; ".join((told + ": " + violations(report), *_too_large(report, limits), would_do))


def _too_large(report: Feasibility, limits: Limits) -> Iterator[str]:
    """Say if no distance at all shows all of the target in so sharp a turn."""
    if report.least_scale_m is None and report.kappa_max_1pm is not None:
        most_m = greatest_target_radius(limits.beta_rad, report.kappa_max_1pm)
        yield (
            "no radius would do: R <= sin(beta / 2)^2 / kappa_max is violated, "
            f"{limits.target_radius_m:.4g} > {most_m:.4g} m"
        )


def _remedies(
    formation: FormationSettings,
    report: Feasibility,
    judge: Judge,
    may_go_on: Callable[[], bool],
) -> Iterator[tuple[str, str]]:
    """Yield names of settings and the nearest value at which all rules hold."""

    def holds(name: str, value: Any) -> bool:
        try:
            return judge(formation.changed({name: value})).feasible
        except PlannerError:
            return False

    broken = set(violated(report))
    flies = formation.drive == "unicycle" and holds("drive", "flying")  # Soon known.
    if formation.strategy not in _SIZELESS and formation.view_file is None:
        size_m = nearest_scale(
            lambda d: holds("radius_m", d),
            formation.radius_m,
            ratio=_RATIO,
            may_go_on=may_go_on,
        )
        if size_m is not None:
            yield "radius_m", f"{size_m:.3f}"
    if broken == {"robots apart"}:
        fewer = range(formation.cameras - 1, 0, -1)
        most = next((n for n in fewer if not may_go_on() or holds("cameras", n)), None)
        most = most if may_go_on() else None
        if most is not None:
            yield "cameras", str(most)
    pace = _PACES.get(formation.strategy)
    if pace is not None and broken <= {"speed", "turning", "margin"}:
        present = float(getattr(formation, pace))
        sign = -1.0 if present < 0 else 1.0
        longer = pace.endswith("_s") and not pace.endswith("deg_s")  # A time, not a rate.
        slower = nearest_scale(
            lambda size: (size > abs(present)) == longer and holds(pace, sign * size),
            abs(present),
            resolution_m=0.01,
            ratio=_PACE_RATIO,
            may_go_on=may_go_on,
        )
        if slower is not None:
            yield pace, f"{sign * slower:.2f}"
    if flies:
        yield "drive", "flying"
