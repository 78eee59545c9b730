"""How long an instant waits for its cameras: as long as their clouds have lately taken."""

from collections import deque

_MARGIN = 1.25
_BACK = 16
"""Ticks; no cloud that is still of use comes so late."""
_REMEMBERED = 128
"""Latenesses: a few seconds of a ring. One cloud that was very late is forgotten after as long."""


class Patience:
    """Follows how much later than an instant's first cloud its others come.

    On one machine these are milliseconds, on a link that loses packets two round trips more, on one
    that is full the time that a cloud takes. Who waits less never sees such a camera; who always
    waits so long is late whenever a camera dies.

    Args:
        least_s: what is waited at least. most_s: what is waited at most, if that is more.
    """

    def __init__(self, least_s: float, most_s: float) -> None:
        self._least_s, self._most_s = least_s, max(least_s, most_s)
        self._began_s: dict[int, float] = {}
        self._late_s: deque[float] = deque(maxlen=_REMEMBERED)

    @property
    def wait_s(self) -> float:
        """How long an instant waits from its first cloud on."""
        if not self._late_s:
            return self._least_s
        return min(max(_MARGIN * max(self._late_s), self._least_s), self._most_s)

    def note(self, tick: int, now_s: float) -> None:
        """Take in when a cloud came; one of an instant long closed teaches, too."""
        if tick + _BACK < max(self._began_s, default=0):
            self._began_s.clear()  # Another run, which counts anew.
        began_s = self._began_s.setdefault(tick, now_s)
        if now_s > began_s:
            self._late_s.append(now_s - began_s)
        while len(self._began_s) > _REMEMBERED:
            del self._began_s[next(iter(self._began_s))]
