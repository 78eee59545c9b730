"""A finding, and the command that mends it."""

from enum import Enum
from typing import Any, NamedTuple


class Level(Enum):
    """How bad it is."""

    GOOD = "ok"
    NOTE = "note"
    """Worth knowing, perhaps wanted."""
    FAILED = "FAIL"


class Verdict(NamedTuple):
    """One line of a report."""

    level: Level
    about: str
    """router, services, rates ..."""
    what: str
    mend: str = ""
    """A command, or what to do; empty when there is nothing to mend."""

    def lines(self) -> list[str]:
        """As one reads it."""
        first = f"{self.level.value:<5} {self.about:<14} {self.what}"
        return [first, f"{'':<5} {'':<14} -> {self.mend}"] if self.mend else [first]

    def plain(self) -> dict[str, Any]:
        """As a machine reads it."""
        return {
            "ok": self.level is not Level.FAILED,
            "level": self.level.name.lower(),
            "about": self.about,
            "what": self.what,
            "mend": self.mend,
        }
