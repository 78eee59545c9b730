"""The world's true states of the last instants."""

from collections import OrderedDict

from schemas.sim import SimState

_KEPT = 128  # 8 s at 15 Hz: a map that is later than that has other problems.


class History:
    """States by tick; forgets the oldest, and everything when time begins anew."""

    def __init__(self) -> None:
        self._states: OrderedDict[int, SimState] = OrderedDict()

    def add(self, state: SimState) -> None:
        """Take in the newest state; an earlier tick than the last means a restart."""
        newest = self.newest
        if newest is not None and state.tick < newest.tick:
            self._states.clear()
        self._states[state.tick] = state
        if len(self._states) > _KEPT:
            self._states.popitem(last=False)

    def at(self, tick: int) -> SimState | None:
        """Return the state of a tick, None when it never came or is forgotten."""
        return self._states.get(tick)

    @property
    def newest(self) -> SimState | None:
        """The last state; None before the first."""
        return next(reversed(self._states.values()), None)
