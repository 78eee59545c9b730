"""Formations of any kind along a whole motion that is known in advance, as they would be told."""

from dataclasses import replace

from schemas.feasibility import Feasibility
from services.planner.feasibility import check_tracks
from services.planner.formation import FormationSettings
from services.planner.known_motion import KnownMotion
from services.planner.remedies import refusal
from services.planner.rules import Limits, of_strategy
from services.planner.strategies.open import open_strategy
from services.planner.tracks import Tracks, tracks_along
from services.planner.wheels import open_carrier
from services.planner.whole_motion import WholePlan

_COARSELY = 24
"""Every so many-th instant tells soon whether it is worth looking at all of them."""


def plan_formation(formation: FormationSettings, motion: KnownMotion, limits: Limits) -> WholePlan:
    """Plan a formation along a motion, and report on it.

    Raises:
        PlannerError: If its strategy cannot be had.
    """

    def judge(other: FormationSettings) -> Feasibility:
        coarse = _report(other, motion.every(_COARSELY), limits)
        return _report(other, motion, limits) if coarse.feasible else coarse

    tracks, held = _tracks(formation, motion), _limits(formation, limits)
    report = check_tracks(tracks, motion.target, held)
    why = None if report.feasible else refusal(formation, report, held, judge)
    return WholePlan(formation.strategy, motion, held, None, tracks, report, why)


def _report(formation: FormationSettings, motion: KnownMotion, limits: Limits) -> Feasibility:
    tracks = _tracks(formation, motion)
    return check_tracks(tracks, motion.target, _limits(formation, limits))


def _limits(formation: FormationSettings, limits: Limits) -> Limits:
    return of_strategy(replace(limits, drive=formation.drive), formation.strategy)


def _tracks(formation: FormationSettings, motion: KnownMotion) -> Tracks:
    strategy = open_strategy(formation.strategy_settings())
    carrier = open_carrier(formation.drive)
    return tracks_along(strategy, carrier, motion, formation.centre_height_m)
