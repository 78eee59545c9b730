"""How the target moves, and has moved at its worst."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from services.planner.live_feasibility import as_unicycle
from services.planner.motion import Motion

_SLOWEST_MPS = 0.05
"""Of a target that is slower, the curvature of its path is noise."""
_RESET_S = 0.25
"""Time that goes back farther was reset; less is a message that was overtaken."""
_SETTLING_S = 5.0
"""So long after the first instant an estimate is not yet believed."""
_SMOOTHING_S = 1.0
"""Time constant of the low-pass through which estimates go: no robot turns sharply for less."""


@dataclass(frozen=True)
class _Bend:
    """How a target moved once."""

    v_mps: float
    omega_rps: float

    @property
    def kappa_1pm(self) -> float:
        return abs(self.omega_rps / self.v_mps)


class SeenMotion:
    """Remembers the sharpest turn and the greatest speed of a target, until time is reset.

    What is told is believed at once. What is estimated from measurements is smoothed, and not
    remembered while the estimate settles: else one noisy instant would be the worst for ever.
    """

    def __init__(self, *, estimated: bool) -> None:
        """Know nothing yet."""
        self._estimated = estimated
        self._forget()

    def _forget(self) -> None:
        self.now: tuple[Motion, float] | None = None
        """How the target moves, and when, s; None before the first instant."""
        self._first_s = 0.0
        self._smooth = _Bend(0.0, 0.0)
        self.sharpest_1pm = 0.0
        """The greatest curvature of its path."""
        self._sharpest: _Bend | None = None
        self._fastest: _Bend | None = None

    def saw(self, target: Motion, t_s: float) -> None:
        """Note how the target moves."""
        if self.now is not None and t_s < self.now[1] - _RESET_S:
            self._forget()
        planar = as_unicycle(target)
        bend = _Bend(float(planar.v_mps), float(planar.omega_rps))
        if self._estimated:
            bend = self._smoothed(bend, t_s)
            ahead = target.T[:3, :3] @ [1.0, 0.0, 0.0]
            target = Motion(target.T, bend.v_mps * ahead, np.array([0.0, 0.0, bend.omega_rps]))
        self.now = target, t_s if self.now is None else max(t_s, self.now[1])
        if self._estimated and t_s < self._first_s + _SETTLING_S:
            return
        if abs(bend.v_mps) < _SLOWEST_MPS:
            return
        if self._sharpest is None or bend.kappa_1pm > self.sharpest_1pm:
            self._sharpest, self.sharpest_1pm = bend, bend.kappa_1pm
        if self._fastest is None or abs(bend.v_mps) > abs(self._fastest.v_mps):
            self._fastest = bend

    def turns(self) -> Iterator[Motion]:
        """Yield the target where it is, moving as at its worst, to the left and to the right."""
        if self.now is None:
            return
        T = self.now[0].T
        ahead = T[:3, :3] @ [1.0, 0.0, 0.0]
        for bend in (self._sharpest, self._fastest):
            if bend is not None:
                for side in (1.0, -1.0):
                    yield Motion(T, bend.v_mps * ahead, np.array([0.0, 0.0, side * bend.omega_rps]))

    def _smoothed(self, bend: _Bend, t_s: float) -> _Bend:
        if self.now is None:
            self._first_s = t_s
            self._smooth = bend
            return bend
        share = 1.0 - float(np.exp(-max(t_s - self.now[1], 0.0) / _SMOOTHING_S))
        self._smooth = _Bend(
            self._smooth.v_mps + share * (bend.v_mps - self._smooth.v_mps),
            self._smooth.omega_rps + share * (bend.omega_rps - self._smooth.omega_rps),
        )
        return self._smooth
