"""Processes that live and do nothing: the supervisor sees only those that end."""

import os
from pathlib import Path

from services.launcher.board import Board

FROZEN_AFTER_S = 20.0
"""Heartbeats come each second, but for a handler that is at work."""
_IDLE_SHARE = 0.02
"""Of a core: who used more since its last heartbeat is at work, however long it takes. The threads
of a session that stands still use less."""
_OWN_GAP_S = 5.0
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Watchdog:
    """Tells which services have fallen silent for good: no heartbeat, and no processor time either.

    The router has no heartbeat, and whoever has not spoken yet is starting. Linux only.
    """

    def __init__(self, board: Board) -> None:
        self._board = board
        self._looked_s: float | None = None
        self._since_s = 0.0
        self._told: set[int] = set()

    def frozen(self, now_s: float) -> list[str]:
        """Return who is to be started anew, each process once; called again and again.

        Args:
            now_s: monotonic.
        """
        if self._looked_s is None or now_s - self._looked_s > _OWN_GAP_S:
            self._since_s = now_s  # It was us who stood still: nobody could be heard.
        self._looked_s = now_s
        found = []
        for name, (status, heard_s) in self._board.statuses.items():
            child = self._board.children.get(name)
            silent_s = now_s - max(heard_s, self._since_s)
            if silent_s <= FROZEN_AFTER_S or child is None or child.pid != status.pid:
                continue
            worked_s = cpu_s(status.pid) - status.cpu_s
            if worked_s < _IDLE_SHARE * silent_s and status.pid not in self._told:
                self._told.add(status.pid)
                found.append(name)
        return found


def cpu_s(pid: int) -> float:
    """Return the processor time of a process; without end where it cannot be known."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return float("inf")
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S  # utime, stime: proc(5).
