"""Some of the places of a formation, the others left open."""

from collections.abc import Sequence

from services.planner.motion import Motion
from services.planner.plan import Plan, Strategy


class Kept:
    """A strategy's places without those that nobody is left for."""

    def __init__(self, strategy: Strategy, places: Sequence[int]) -> None:
        """Keep some places.

        Args:
            strategy: of the whole formation.
            places: rows of its views, rising.
        """
        self.rests = strategy.rests
        self._strategy, self._places = strategy, tuple(places)

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Plan them all and leave some out."""
        plan = self._strategy.plan(target, t_s)
        corners, psi = plan.polygon_m, plan.psi_rad
        return Plan(
            views=tuple(plan.views[place] for place in self._places),
            centre_m=plan.centre_m,
            radius_m=plan.radius_m,
            polygon_m=tuple(corners[place] for place in self._places) if corners else (),
            psi_rad=None if psi is None else psi[list(self._places)],
        )
