"""The time of a recording: that of its measurements; it goes on where a simulation began anew."""

from collections.abc import Collection

from schemas.topics import MAP_CHANGES, SIM_CLOCK, SIM_STATE, TARGET_POSE
from services.recorder.export.errors import ExportError

_CLOCKS = (SIM_STATE.key, TARGET_POSE.key, MAP_CHANGES.key, SIM_CLOCK.key)
"""Who tells the time, the best first: what comes once per instant and before all else of it."""


class Timeline:
    """Follows the clock of a recording, nanoseconds.

    Stamps are in simulated time, or the wall's; a reset sets them back. All stamps of a
    recording, shifted, lie on one line.
    """

    def __init__(self, keys: Collection[str]) -> None:
        """Choose the clock among the keys that were recorded.

        Raises:
            ExportError: If none of them tells the time.
        """
        clocks = [key for key in _CLOCKS if key in keys]
        clocks += sorted(key for key in keys if key.startswith("cams/") and key.endswith("/cloud"))
        if not clocks:
            raise ExportError(
                f"it has no clock: none of {', '.join(_CLOCKS)} or cams/<i>/cloud was recorded"
            )
        self.clock = clocks[0]
        """The key whose messages tell the time."""
        self.shift_ns = 0
        """To be added to all stamps."""
        self._first_ns: int | None = None
        self._last_ns = 0

    def advance(self, t_ns: int) -> None:
        """Take in a stamp of the clock's."""
        if self._first_ns is None:
            self._first_ns = t_ns
        elif t_ns < self._last_ns:
            self.shift_ns += self._last_ns - t_ns
        self._last_ns = t_ns

    def elapsed_s(self, t_ns: int) -> float:
        """Return how long after the first instant a stamp is."""
        first_ns = t_ns if self._first_ns is None else self._first_ns
        return (t_ns + self.shift_ns - first_ns) * 1e-9
