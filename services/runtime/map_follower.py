"""A mirror of the map that stays whole: begun anew with another mapper, healed after a gap."""

import logging

from schemas.map import MapChanges, MapFull
from schemas.message import MessageError
from schemas.topics import MAP_FULL
from services.runtime.bus import Bus
from services.runtime.errors import NoReply
from services.runtime.map_mirror import MapMirror, Outcome
from services.runtime.reader import Received

logger = logging.getLogger(__name__)

_SNAPSHOT_TIMEOUT_S = 0.5  # Asked again at the next changes.


class MapFollower:
    """Feed it all changes in order, from whichever mapper."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._boot = ""
        self.mirror = MapMirror()

    def take(self, received: Received[MapChanges]) -> MapChanges | MapFull | None:
        """Take changes in.

        Returns:
            What the mirror now holds the map of; None if that is not known.
        """
        self.know(received.envelope.boot)
        if self.mirror.apply(received.message) is Outcome.GAP and not self._heal():
            return None
        return self.mirror.latest

    def know(self, boot: str) -> bool:
        """Note which process the mapper is; return whether it is another than before."""
        if boot == self._boot:
            return False
        self._boot = boot
        self.mirror.forget()
        return True

    def _heal(self) -> bool:
        before = self.mirror.rev
        try:
            full = self._bus.fetch(MAP_FULL, _SNAPSHOT_TIMEOUT_S)
        except (NoReply, MessageError) as error:
            logger.warning("missed changes after rev %d: %s", before, error)
            return False
        logger.info("missed changes after rev %d: healed at rev %d", before, full.rev)
        self.mirror.reset(full)
        return True
