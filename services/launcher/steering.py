"""What is asked of a run while it goes on: `ctl/launcher/<verb>`, and what follows from it."""

from collections.abc import Callable, Mapping
from typing import Self

from services.launcher.board import Board
from services.launcher.desk import Desk
from services.launcher.fleet import Fleet
from services.launcher.processes import ProcessSpec
from services.launcher.scenery import Scenery
from services.launcher.supervisor import Supervisor
from services.runtime.bus import Bus


class Steering:
    """Answers requests and sees them through, on the thread that calls `tend`.

    Args:
        table: the run's processes by name, for a number of cameras.
        supervisor: of these processes.
        board: what is known of the run.
        bus: of the launcher.
    """

    def __init__(
        self,
        table: Callable[[int], Mapping[str, ProcessSpec]],
        supervisor: Supervisor,
        board: Board,
        bus: Bus,
    ) -> None:
        self._board, self._bus = board, bus
        self._fleet = Fleet(board.record.num_cameras, supervisor, table, bus.request)
        self._scenery = Scenery(bus.request)

    def __enter__(self) -> Self:
        self._desk = Desk(self._bus, {"get": self._fleet.get, "set": self._fleet.set})
        self._stop = self._bus.presence.watch("camera", self._fleet.note)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()
        self._desk.close()

    def tend(self) -> None:
        """Answer what was asked, and go on with what takes longer."""
        self._desk.attend()
        if self._board.summary is not None:  # Tick 0 waits for those that the run begins with.
            self._fleet.update()
        self._board.record.num_cameras = self._fleet.at_work
        if self._board.scene is not None:
            self._scenery.update(self._board.scene)
