"""How fast the simulation's instants follow each other, and so what a declared rate means."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.sim import SimClock
from schemas.topics import RATE_HZ
from services.inspector import remedies
from services.inspector.verdict import Level, Verdict
from services.runtime.meter import RATE_SHARE


@dataclass(frozen=True)
class Pace:
    """What the clock said while we listened; without a simulation nothing is known of it."""

    clocks: Sequence[SimClock]
    connect: str
    """Where the router is, for the commands that mend."""

    @property
    def runs(self) -> bool:
        """Whether instants come, as far as is known."""
        return self._num > 0 if self._timed else not self.clocks

    @property
    def words(self) -> str:
        """The pace, in words."""
        if not self.runs or not self.clocks:
            return ""
        last = self.clocks[-1]
        pace = f"{self._num / self._wall_s:.1f} instants/s"
        if last.mode == "lockstep":
            return f"lockstep, {pace}: as fast as all can, declared are {RATE_HZ:g}"
        return f"realtime, {pace} of {1e9 / last.dt_ns:.1f}"

    def verdicts(self) -> list[Verdict]:
        """What is wrong with the pace itself."""
        if not self.clocks:
            return []
        last = self.clocks[-1]
        if last.state != "running":
            return [self._stopped(last)]
        if not self.runs:
            what = f"the simulation says that it runs and stands at tick {last.tick}"
            return [Verdict(Level.FAILED, "rates", what, "encircle echo sim/clock")]
        if last.dropped:
            what = f"the simulation goes on without {', '.join(last.dropped)}"
            mend = remedies.start(last.dropped[0], self.connect)
            return [Verdict(Level.FAILED, "rates", what, mend)]
        if last.mode == "realtime" and self._num / self._wall_s < RATE_SHARE * 1e9 / last.dt_ns:
            what = f"{self.words}; {last.overruns} came too late so far"
            return [Verdict(Level.FAILED, "rates", what, remedies.FASTER)]
        return []

    def expected(self, declared_hz: float, from_ns: int, to_ns: int) -> float:
        """How many messages are due between two times (wall clock).

        What is declared at the rate of instants follows their pace; a heartbeat does not.
        """
        span_s = (to_ns - from_ns) * 1e-9
        if declared_hz < RATE_HZ or not self._timed:
            return declared_hz * span_s
        times_ns = [clock.t_wall_ns for clock in self.clocks]
        ticks = [clock.tick for clock in self.clocks]
        first, last = np.interp([from_ns, to_ns], times_ns, ticks)
        return float(last - first) * declared_hz / RATE_HZ

    @property
    def _num(self) -> int:
        return self.clocks[-1].tick - self.clocks[0].tick

    @property
    def _wall_s(self) -> float:
        return (self.clocks[-1].t_wall_ns - self.clocks[0].t_wall_ns) * 1e-9

    @property
    def _timed(self) -> bool:
        return len(self.clocks) > 1 and self._wall_s > 0

    def _stopped(self, clock: SimClock) -> Verdict:
        waits = f" for {', '.join(clock.waiting_for)}" if clock.waiting_for else ""
        what = f"the simulation is {clock.state}{waits} at tick {clock.tick}; rates are not judged"
        level = Level.FAILED if clock.state == "waiting" else Level.NOTE
        return Verdict(level, "rates", what, remedies.for_clock(clock, self.connect))
