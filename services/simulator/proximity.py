"""Counting how often cameras touched something or came too close."""

from collections.abc import Sequence

from services.simulator.bodies import Encounter


class Proximity:
    """Counts each encounter once, when it begins."""

    def __init__(self) -> None:
        self.num_contacts = 0
        self.num_close = 0
        """Encounters below the clearance, contacts included."""
        self._close: set[tuple[str, str]] = set()
        self._touching: set[tuple[str, str]] = set()

    def update(self, encounters: Sequence[Encounter]) -> list[Encounter]:
        """Take the encounters of this tick and return those that have just become contacts."""
        close = {(e.one, e.other) for e in encounters}
        touching = [e for e in encounters if e.distance_m <= 0.0]
        new = [e for e in touching if (e.one, e.other) not in self._touching]
        self.num_close += len(close - self._close)
        self.num_contacts += len(new)
        self._close, self._touching = close, {(e.one, e.other) for e in touching}
        return new
