"""Formations that are asked for while running: let in, or refused with what would do."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

import numpy as np

from schemas.feasibility import Feasibility
from services.kernels.rigid import FloatArray, apply
from services.planner.errors import InfeasibleError
from services.planner.feasibility import check_tracks
from services.planner.foreknowledge import Foreknowledge
from services.planner.formation import FormationSettings
from services.planner.known_motion import KnownMotion, curvature
from services.planner.live_feasibility import as_unicycle
from services.planner.moments import moments
from services.planner.motion import Motion, still
from services.planner.mounts import fitted, wanted
from services.planner.planar import PlanarMotion
from services.planner.remedies import refusal
from services.planner.rules import Drive, Limits, of_strategy
from services.planner.seen_motion import SeenMotion
from services.planner.strategies.open import open_strategy
from services.planner.tracks import spatial, tracks_told
from services.planner.wheels import Mounted, open_carrier

_SEARCH_S = 0.5
"""Processor time for the search of what would do: references wait for it."""
_KNOWN_INSTANTS = 8
"""So many of a known path, evenly, besides its extremes."""


class Gate:
    """Remembers how the target moves at its worst, and holds what is asked for against that.

    A formation must be feasible with the target's present motion, with the sharpest turn and with
    the greatest speed seen so far, to the left and to the right, and along all of the path, if that
    is known.
    """

    def __init__(
        self,
        limits: Callable[[Drive], Limits],
        known: KnownMotion | None = None,
        *,
        estimated: bool = False,
    ) -> None:
        """Know nothing of the target's motion but its path.

        Args:
            limits: of cameras and robots.
            known: the target's path, if it is known.
            estimated: whether its motion is estimated from measurements, not told.
        """
        self.foreknowledge = Foreknowledge(limits, known)
        self._limits = limits
        self._extremes, self._evenly = ((), ()) if known is None else _looked_at(known)
        self._seen = SeenMotion(estimated=estimated)
        self._there_rad = np.empty(0)

    def saw(self, target: Motion, t_s: float) -> None:
        """Note how the target moves."""
        self._seen.saw(target, t_s)

    def mounted(self, psi_rad: FloatArray | None) -> None:
        """Note (M,) how the cameras are fixed on their robots; None: they fly."""
        self._there_rad = np.empty(0) if psi_rad is None else psi_rad

    def admit(self, formation: FormationSettings, asked: Collection[str] = ()) -> None:
        """Let a formation pass.

        Args:
            formation: that is wished for.
            asked: names of the settings that were to be changed.

        Raises:
            InfeasibleError: If it breaks a rule and infeasible ones are refused.
            PlannerError: If its strategy cannot be had.
        """
        if formation.infeasible == "allow":
            return
        report = self.judge(formation)
        if not report.feasible:
            limits = self.limits(formation)
            raise InfeasibleError(refusal(formation, report, limits, self.judge, asked, _SEARCH_S))

    def judge(self, formation: FormationSettings) -> Feasibility:
        """Report on a formation in the worst of what is known of the target.

        Raises:
            PlannerError: If its strategy cannot be had.
        """
        instants: list[tuple[tuple[Mounted, ...], FloatArray]] = []
        targets = []
        for target, times_s in self._motions(formation):
            # Each by itself: who looks ahead begins where it is safe.
            strategy = open_strategy(formation.strategy_settings(), self.foreknowledge)
            for t_s in times_s:
                plan = strategy.plan(target, float(t_s))
                views = plan.views
                # Each instant by itself: robots that have always driven so, as they are built.
                carrier = open_carrier(formation.drive)
                psi_rad = fitted(wanted(plan, views, target), self._there_rad)
                told = carrier.carry(range(len(views)), views, target, float(t_s), psi_rad)
                instants.append((told, apply(target.T, [0.0, 0.0, formation.centre_height_m])))
                targets.append(as_unicycle(target))
        return check_tracks(tracks_told(instants), _all(targets), self.limits(formation))

    def limits(self, formation: FormationSettings) -> Limits:
        """Return what a formation is held against."""
        return of_strategy(self._limits(formation.drive), formation.strategy)

    def _motions(self, formation: FormationSettings) -> Iterator[tuple[Motion, FloatArray]]:
        """Yield the targets, and when, s, that a formation must be able to follow."""
        yield from ((target, moments(formation, t_s)) for target, t_s in self._extremes)
        yield from ((target, np.array([t_s])) for target, t_s in self._evenly)
        if self._seen.now is not None:
            target, t_s = self._seen.now
            for each in (target, *self._seen.turns()):
                yield each, moments(formation, t_s)
        elif not self._extremes:
            # Where it will be is not known: as good as in the middle. Nothing moves as yet.
            place = np.eye(4)
            place[:2, 3] = formation.centre_m
            yield still(place), moments(formation, 0.0)


_Instants = tuple[tuple[Motion, float], ...]


def _looked_at(known: KnownMotion) -> tuple[_Instants, _Instants]:
    """Return a known path at its extremes, and here and there."""
    target = known.target
    extremes = [
        np.argmax(np.abs(curvature(target))),
        np.argmax(np.abs(target.v_mps)),
        np.argmax(np.abs(target.omega_rps)),
    ]
    even = np.linspace(0, len(known.t_s) - 1, _KNOWN_INSTANTS, dtype=np.int64)
    motions = spatial(target).each()

    def at(indices: Iterable[np.int64]) -> _Instants:
        return tuple((motions[k], float(known.t_s[k])) for k in indices)

    return at(extremes), at(even)


def _all(targets: Sequence[PlanarMotion]) -> PlanarMotion:
    """Put instants together."""
    names = ("x_m", "y_m", "phi_rad", "v_mps", "omega_rps")
    return PlanarMotion(*(np.array([getattr(each, name) for each in targets]) for name in names))
