"""`encircle plan`: whether a formation can be driven, and what it looks like."""

import json
import math
import sys
from collections.abc import Sequence

from rich.console import Console

from services.launcher.errors import MissingExtraError, SettingsError
from services.launcher.plan_settings import PlanSettings, from_run, parse_plan
from services.launcher.plan_table import as_json, show
from services.launcher.processes import planner_flags
from services.launcher.settings import RunSettings
from services.planner.errors import InfeasibleError, PlannerError
from services.planner.formation import FormationSettings
from services.planner.gate import Gate
from services.planner.known_motion import known_path
from services.planner.rules import Limits
from services.planner.settings import PlannerSettings
from services.planner.whole_formation import plan_formation
from services.planner.whole_motion import WHOLE, WholePlan, greatest_scale, plan_whole

FEASIBLE, INFEASIBLE, USAGE = 0, 1, 2


def plan(args: Sequence[str]) -> int:
    """Carry out `encircle plan` and return its exit code: 0 feasible, 1 infeasible, 2 usage.

    Raises:
        SettingsError: If a flag or the scenario is not usable.
        MissingExtraError: If a picture is wanted and matplotlib is not installed.
    """
    settings = parse_plan(args)
    try:
        made = make(settings)
    except InfeasibleError as error:
        if settings.json_:
            print(json.dumps({"feasible": False, "refusal": str(error)}, indent=2))
        print(f"infeasible: {error}", file=sys.stderr)
        return INFEASIBLE
    except PlannerError as error:
        print(f"encircle plan: {error}", file=sys.stderr)
        return USAGE
    if settings.json_:
        print(as_json(made))
    else:
        show(made, Console(highlight=False, soft_wrap=True, markup=False))
    if settings.plot is not None:
        _draw(made, settings)
    return INFEASIBLE if made.refusal else FEASIBLE


def refuse_infeasible(run: RunSettings) -> None:
    """Check the formation of a run along its path before anything is started.

    Raises:
        SettingsError: If it is infeasible; with the violated inequality and what would do.
    """
    if run.infeasible == "allow":
        return
    try:
        refusal = make(PlanSettings.model_validate(from_run(run))).refusal
        if refusal is None:
            # What looks ahead while it runs may do less than a plan of the whole motion.
            told = _told(run)
            gate = Gate(told.limits, told.known_motion(), estimated=told.target != "given")
            gate.admit(told.formation())
    except PlannerError as error:
        refusal = str(error)
    if refusal is not None:
        raise SettingsError(f"infeasible: {refusal}; --infeasible allow runs it nevertheless")


def _told(run: RunSettings) -> PlannerSettings:
    """Return the settings of the run's planner."""
    flags = {flag.replace("-", "_"): value for flag, value in planner_flags(run).items()}
    given = {name: value for name, value in flags.items() if value is not None}
    return PlannerSettings.model_validate(given)


def make(settings: PlanSettings) -> WholePlan:
    """Plan what the settings ask for.

    Raises:
        InfeasibleError: If there is no such formation.
        PlannerError: If nothing says how large it shall be.
    """
    turn_dps, up_deg = settings.omega_max_dps, settings.beta_up_deg
    limits = Limits(
        beta_rad=math.radians(settings.beta_deg - settings.margin_deg),
        drive=settings.drive,
        target_radius_m=settings.target_radius_m,
        v_max_mps=settings.v_max_mps,
        omega_max_rps=None if turn_dps is None else math.radians(turn_dps),
        robot_radius_m=settings.robot_radius_m,
        robot_distance_m=settings.robot_distance_m,
        range_min_m=settings.range_min_m,
        range_max_m=settings.range_max_m,
        margin_rad=math.radians(settings.margin_deg),
        delay_s=settings.delay_s,
        bearing_noise_rad=math.radians(settings.bearing_noise_deg),
        beta_up_rad=None if up_deg is None else math.radians(up_deg - settings.margin_deg),
        elevation_rad=math.radians(settings.elevation_deg),
    )
    motion = known_path(settings.path, settings.semi_axes_m, settings.lap_s)
    d_m = settings.radius_m
    if d_m is None and settings.strategy != "dome":
        d_m = greatest_scale(motion, limits)
    for whole in WHOLE:
        if settings.strategy == whole and d_m is not None:
            return plan_whole(whole, motion, settings.cameras, d_m, limits, settings.alpha)
    return plan_formation(_formation(settings, d_m), motion, limits)


def _formation(settings: PlanSettings, d_m: float | None) -> FormationSettings:
    """Return what the live planner would be asked for."""
    both = FormationSettings.model_fields.keys() & PlanSettings.model_fields.keys()
    wanted = {name: getattr(settings, name) for name in both - {"radius_m"}}
    return FormationSettings().changed(wanted | ({} if d_m is None else {"radius_m": d_m}))


def _draw(made: WholePlan, settings: PlanSettings) -> None:
    from services.launcher.plan_chart import draw

    assert settings.plot is not None
    try:
        draw(made, settings.plot)
    except ImportError as error:
        raise MissingExtraError(
            f"--plot needs {error.name}; pip install 'encircle[report]'"
        ) from error
    except OSError as error:
        raise SettingsError(f"--plot {settings.plot}: {error.strerror}") from error
