"""Where the run can be seen: told once, as soon as the viewer says so itself."""

from collections.abc import Callable

from services.launcher.board import Board
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed, NoReply

_TIMEOUT_S = 0.5
_VIEWER = "viewer"


class Page:
    """Asks the viewer, which takes the next free port when its own is taken."""

    def __init__(self, bus: Bus, board: Board, say: Callable[[str], None]) -> None:
        self._bus, self._board, self._say = bus, board, say
        self._told_pid: int | None = None

    def tell(self) -> None:
        """Say the address once; again when the viewer had to be started again."""
        if _VIEWER not in self._board.statuses:
            return
        pid = self._board.statuses[_VIEWER][0].pid
        if pid == self._told_pid:
            return
        try:
            url = self._bus.request(_VIEWER, "get", timeout_s=_TIMEOUT_S).get("url")
        except (NoReply, CommandFailed):
            return  # It has hardly come up: asked again.
        self._told_pid = pid
        self._say(f"see it at {url}")
