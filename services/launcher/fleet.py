"""How many cameras a run has: their processes begin and end while it goes on."""

import logging
from collections.abc import Callable, Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.launcher.processes import ProcessSpec
from services.launcher.supervisor import Child, Supervisor
from services.runtime.command import only
from services.runtime.errors import CommandFailed, NoReply

logger = logging.getLogger(__name__)

Ask = Callable[[str, str, dict[str, Any]], object]
"""Asks a service for a verb with parameters; raises NoReply or CommandFailed."""
_TOLD = ("planner", "simulator")


class Wanted(BaseModel):
    """What `ctl/launcher/set` takes."""

    model_config = ConfigDict(frozen=True)

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    """How many cameras, each its own process."""


class Fleet:
    """One request, and everybody who is concerned follows.

    More: the processes are started; when all of them are on the bus, the planner places them and
    the simulator gives them room, so that no instant waits for a camera that is still loading.
    Fewer: the planner closes up and the processes are ended; when they are gone, so is their room.

    Args:
        cameras: that the run begins with.
        supervisor: of their processes; all is done on its thread.
        table: the run's processes by name, for a number of cameras.
        ask: how planner and simulator are told.
    """

    def __init__(
        self,
        cameras: int,
        supervisor: Supervisor,
        table: Callable[[int], Mapping[str, ProcessSpec]],
        ask: Ask,
    ) -> None:
        self._supervisor, self._table, self._ask = supervisor, table, ask
        self.wanted = self.told = cameras
        """What was asked for, and what planner and simulator know."""
        self._alive: set[int] = set()
        self._trouble = ""

    @property
    def at_work(self) -> int:
        """How many cameras take part in every instant."""
        return min(self.wanted, self.told)

    def note(self, instance: str, alive: bool) -> None:
        """Take in that a camera came to the bus, or left it; from any thread."""
        if instance.isdecimal():
            (self._alive.add if alive else self._alive.discard)(int(instance))

    def get(self, params: dict[str, Any]) -> dict[str, Any]:
        """Answer `ctl/launcher/get`."""
        only(params)
        cameras = self._cameras()
        return {
            "cameras": self.wanted,
            "running": sorted(i for i in cameras if i < self.at_work),
            "starting": list(range(self.told, self.wanted)),
            "ending": sorted(i for i in cameras if i >= self.wanted),
            "trouble": self._trouble,
        }

    def set(self, params: dict[str, Any]) -> dict[str, Any]:
        """Answer `ctl/launcher/set`: begin or end processes; `update` does the rest.

        Raises:
            BadCommand: If a name is not known.
            ValidationError: If the number is out of its limits.
            CommandFailed: If the planner has no formation of so few.
            NoReply: If the planner is not there.
        """
        only(params, *Wanted.model_fields)
        wanted = Wanted.model_validate({"cameras": self.wanted} | params).cameras
        if wanted < self.told:
            self._ask("planner", "set", {"cameras": wanted})
        elif self.wanted < self.told:  # They were to leave, and stay now.
            self._ask("planner", "set", {"cameras": self.told})
        self.wanted, self._trouble = wanted, ""
        self._end_surplus()
        return self.get({})

    def update(self) -> None:
        """Go on with what was asked for; does nothing when all is done."""
        table = self._table(self.wanted) if self._lacking() else {}
        for index in self._lacking():
            self._supervisor.add(table[f"camera/{index}"])
        cameras = self._cameras()
        new = [cameras[index] for index in range(self.told, self.wanted)]
        if any(child.state == "failed" for child in new):
            self._give_up("their processes cannot be kept alive")
        elif new:
            running = all(child.state == "running" for child in new)
            if running and self._alive.issuperset(range(self.told, self.wanted)):
                self._tell()
        elif self.wanted < self.told and max(cameras, default=0) < self.wanted:
            self._tell()

    def _lacking(self) -> list[int]:
        """Return who is to be started; one that is just ending has to end first."""
        known = self._cameras()
        return [index for index in range(self.wanted) if index not in known]

    def _cameras(self) -> dict[int, Child]:
        return {
            int(name.partition("/")[2]): child
            for name, child in self._supervisor.children.items()
            if child.spec.service == "camera"
        }

    def _tell(self) -> None:
        try:
            for service in _TOLD:
                self._ask(service, "set", {"cameras": self.wanted})
        except NoReply as error:
            logger.warning("tried again: %s", error)
            return
        except CommandFailed as error:
            self._give_up(str(error))
            return
        self.told = self.wanted
        table = self._table(self.told)
        for service in _TOLD:  # Should one crash, it is started again as it is now.
            self._supervisor.children[service].spec = table[service]
        logger.info("%d cameras", self.told)

    def _give_up(self, reason: str) -> None:
        trouble = f"{self.wanted} cameras are not to be had: {reason}"
        logger.warning("%s", trouble)
        self.wanted, self._trouble = self.told, trouble
        try:  # It may have planned for more before somebody else refused.
            self._ask("planner", "set", {"cameras": self.told})
        except (CommandFailed, NoReply) as error:
            self._trouble += f"; the planner may still plan for them: {error}"
        self._end_surplus()

    def _end_surplus(self) -> None:
        for index in self._cameras():
            if index >= self.wanted:
                self._supervisor.end(f"camera/{index}")
