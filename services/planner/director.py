"""Who goes where: the formation that is asked for, with the cameras that there are."""

from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.assignment import assign, sharpened, travel
from services.planner.errors import PlannerError
from services.planner.foreknowledge import Foreknowledge
from services.planner.formation import FormationSettings
from services.planner.formed import Formed, Joined
from services.planner.here import Here
from services.planner.kept import Kept
from services.planner.motion import Motion
from services.planner.mounts import Mounts, wanted
from services.planner.pace import Pace
from services.planner.plan import Plan, Strategy
from services.planner.roster import Roster
from services.planner.sideways import sideways
from services.planner.source import Source
from services.planner.strategies.open import NOTHING_KNOWN, open_strategy
from services.planner.transition import Transition
from services.planner.turned import Turned, nearest_turn, turns_freely

_RESET_S = 0.25
"""Time that goes back farther was reset; less is a message that was overtaken."""
_SILENT_S = 0.1
"""A change begins no longer ago than this: where references were before a silence is long past."""
_CLOSING = 1.1
"""Gaps are closed faster than formations change: nobody sees what was lost until then."""
_MOST_NESTED = 4
"""Changes under way at once; a further one waits until the oldest is through."""


@dataclass(frozen=True)
class Orders:
    """What every camera is told at one instant."""

    cameras: tuple[int, ...]
    views: tuple[Motion, ...]
    """World frame, one per camera."""
    num_working: int
    """So many make the formation; the rest are spare and wait farther out."""
    strategy: str
    plan: Plan
    """Of the formation when it is complete."""
    psi_rad: FloatArray | None
    """(N,) how each camera is fixed on its robot, from the heading; None: they fly."""


class Director:
    """Keeps references continuous while formation and cameras change.

    It holds: what is asked for, who is there, and where references come from now: a formation, or
    a transition that leads to it.
    """

    def __init__(self, formation: FormationSettings, known: Foreknowledge = NOTHING_KNOWN) -> None:
        self._known = known
        self._roster, self._mounts = Roster(), Mounts()
        self._seen: dict[int, FloatArray] = {}
        self._last_s: float | None = None
        self._standing: object = None
        self._goal: Formed | None = None
        self._source: Source | None = None
        self.change(formation)

    def change(self, formation: FormationSettings) -> None:
        """Ask for another formation.

        Raises:
            PlannerError: If its strategy cannot be had; then nothing changes.
        """
        self._opened = open_strategy(formation.strategy_settings(), self._known)
        self.formation = formation
        if formation.drive == "flying":
            self._mounts = Mounts()

    def appear(self, camera: int) -> None:
        """Make room for a camera."""
        self._roster.appear(camera)

    def vanish(self, camera: int) -> None:
        """Close the gap that a camera leaves."""
        self._roster.vanish(camera)

    def saw(self, camera: int, T_world_camera: FloatArray) -> None:
        """Note where a camera is."""
        self._seen[camera] = T_world_camera

    def plan(self, target: Motion, t_s: float) -> Orders:
        """Return the references for the instant `t_s` at which the target is `target`."""
        if self._last_s is not None and t_s < self._last_s - _RESET_S:
            self._begin_anew()
        if isinstance(self._source, Transition) and self._source.done(t_s):
            self._source = self._source.after
        crew, num = self._roster.crew(self.formation.cameras, self._seen)
        wanted = (self.formation, crew, num)
        if wanted != self._standing and _nested(self._source, t_s) < _MOST_NESTED:
            last_s = t_s if self._last_s is None else self._last_s
            self._reform(target, max(last_s, t_s - _SILENT_S), crew, num)
            self._standing = wanted
        self._last_s = t_s if self._last_s is None else max(t_s, self._last_s)
        assert self._goal is not None
        assert self._source is not None
        if self._source is self._goal:
            views = self._goal.views(target, t_s)
        else:
            views = target.carry(self._source.at(target, t_s)).each()
        return Orders(
            cameras=self._goal.cameras,
            views=views,
            num_working=self._goal.num_working,
            strategy=self.formation.strategy,
            plan=self._goal.plan(target, t_s),
            psi_rad=self._fixed(self._goal, target, t_s),
        )

    def _fixed(self, goal: Formed, target: Motion, t_s: float) -> FloatArray | None:
        if self.formation.drive == "flying":
            return None
        psi_rad = wanted(goal.plan(target, t_s), goal.views(target, t_s), target)
        return self._mounts.fixed(goal.cameras, psi_rad)

    def _begin_anew(self) -> None:
        """Time went back: the world was reset, and places its cameras where we send them."""
        self._seen.clear()
        self._mounts = Mounts()
        self._last_s = self._standing = self._goal = self._source = None

    def _reform(self, target: Motion, start_s: float, crew: tuple[int, ...], num: int) -> None:
        """Give the cameras their places and lead them there from where they are."""
        try:
            goal = Formed(self._strategy_of(num), crew, num)
        except PlannerError:
            if self._goal is None:
                raise
            return  # It takes no fewer cameras: the gap stays open.
        joined = Joined(self._source, self._seen, goal)
        if len(joined.unknown) == len(crew):
            self._goal = self._source = goal
            return
        has_gap = num < self.formation.cameras
        here = self._here(target, start_s)
        pace = Pace(self.formation.change_speed_mps * (_CLOSING if has_gap else 1.0))
        if has_gap:
            goal = self._with_gap(joined, goal, here, pace)
        else:
            goal = goal.ordered(self._by_place(joined, goal, here))
        joined = Joined(self._source, self._seen, goal)
        if self.formation.drive == "unicycle":
            pace = pace._replace(speed_mps=min(pace.speed_mps, sideways(joined, goal, here)))
        self._goal = goal
        self._source = Transition(
            before=joined,
            after=goal,
            here=here,
            pace=pace,
            safe_m=self.formation.safe_distance_m,
        )

    def _with_gap(self, joined: Joined, goal: Formed, here: Here, pace: Pace) -> Formed:
        """Return the places of those that are left, nearest to where they are."""
        if self.formation.drive == "unicycle":
            # A camera fixed on wheels sees the target from its own place on the circle alone.
            num = self.formation.cameras
            whole = Formed(self._opened, tuple(range(num)), num)
            columns = assign(self._costs(joined, whole, here))
            order = np.argsort(columns)
            cameras = tuple(goal.cameras[row] for row in order)
            return Formed(Kept(self._opened, columns[order].tolist()), cameras, goal.num_working)
        if turns_freely(self.formation.strategy_settings()):
            turn_rad = nearest_turn(here.course(joined), here.course(goal), pace)
            strategy = Turned(self._strategy_of(goal.num_working), turn_rad)
            goal = Formed(strategy, goal.cameras, goal.num_working)
        return goal.ordered(self._by_place(joined, goal, here, sharpen=True))

    def _by_place(
        self, joined: Joined, goal: Formed, here: Here, *, sharpen: bool = False
    ) -> tuple[int, ...]:
        """Return the cameras in the order of places, each in the one it has the least way to."""
        costs = self._costs(joined, goal, here)
        order = np.argsort(assign(sharpened(costs) if sharpen else costs))
        return tuple(goal.cameras[row] for row in order)

    def _costs(self, joined: Joined, goal: Formed, here: Here) -> FloatArray:
        start, end = here.course(joined), here.course(goal)
        costs = travel(start, end)
        costs[joined.unknown] = 0.0
        if self.formation.drive == "unicycle":
            plan = goal.plan(here.target, here.t_s)
            psi_rad = wanted(plan, plan.views, here.target)
            # Who is spare need not see the target.
            costs[:, : len(psi_rad)] += self._mounts.misfit(joined.cameras, psi_rad)
        return costs

    def _here(self, target: Motion, t_s: float) -> Here:
        return Here(target, t_s, np.array([0.0, 0.0, self.formation.centre_height_m]))

    def _strategy_of(self, num: int) -> Strategy:
        if num == self.formation.cameras:
            return self._opened
        fewer = self.formation.changed({"cameras": num})
        return open_strategy(fewer.strategy_settings(), self._known)


def _nested(source: Source | None, t_s: float) -> int:
    depth = 0
    while isinstance(source, Transition) and not source.done(t_s):
        depth += 1
        before = source.before
        source = before.before if isinstance(before, Joined) else None
    return depth
