"""When ticks are due that follow the wall clock."""


class Pace:
    """Absolute deadlines, one step apart; when late, time slips and the step is never enlarged."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self._due_s = 0.0
        self.overruns = 0
        """Ticks that were due before their predecessor was done."""

    def begin(self, now_s: float) -> None:
        """Count from now."""
        self._due_s = now_s

    def wait_s(self, now_s: float) -> float:
        """Return how long to wait for the next tick, which is one step after the last."""
        self._due_s += self._dt_s
        if self._due_s < now_s:
            self.overruns += 1
            self._due_s = now_s
        return self._due_s - now_s
