"""What was found out about the bus: the ground of every verdict."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from schemas.sim import SimClock
from schemas.status import ServiceStatus, TopicStatus


class RouterFacts(NamedTuple):
    """The router, as a new session finds it."""

    fault: str = ""
    """Why no session came about; empty when one did."""
    refused: bool = False
    """Whether nobody listens there at all."""
    seconds: float = 0.0
    """What opening a session took."""
    version: str = ""
    """Zenoh's."""
    sessions: int = 0
    """How many it has, ours included."""


class Beat(NamedTuple):
    """One heartbeat."""

    status: ServiceStatus
    t_pub_ns: int


@dataclass(frozen=True)
class Facts:
    """Of one look at the bus."""

    connect: str
    """Where the router was sought."""
    router: RouterFacts
    alive: frozenset[str] = frozenset()
    """Liveliness tokens, `service/instance`."""
    beats: Mapping[str, tuple[Beat, ...]] = field(default_factory=dict)
    """Heartbeats of each `service/instance`, in order."""
    clocks: tuple[SimClock, ...] = ()
    """What the simulation's clock said, in order."""
    delays_s: Mapping[str, float] = field(default_factory=dict)
    """Shortest time from a sender's stamp to our reception, by `service/instance`: transport and
    the difference of the clocks."""

    @property
    def replayed(self) -> bool:
        """Whether a recording is being said again: stamps, and who says so, are of then."""
        return bool(self.instances("replay"))

    def last(self, address: str) -> ServiceStatus | None:
        """The newest heartbeat of a service."""
        beats = self.beats.get(address)
        return beats[-1].status if beats else None

    def senders(self, key: str) -> dict[str, TopicStatus]:
        """Who says of itself that it has sent on a key."""
        return self._with(key, sent=True)

    def readers(self, key: str) -> dict[str, TopicStatus]:
        """Who says of itself that it has received on a key."""
        return self._with(key, sent=False)

    def instances(self, service: str) -> list[str]:
        """Who of a service is alive, in order."""
        names = (name for name in self.alive if name.partition("/")[0] == service)
        return sorted(names, key=lambda name: (len(name), name))

    def _with(self, key: str, *, sent: bool) -> dict[str, TopicStatus]:
        return {
            address: topic
            for address, beats in sorted(self.beats.items())
            for topic in beats[-1].status.topics
            if topic.key == key and topic.sent == sent
        }


def address_of(src: str) -> str:
    """Return `service/instance` of an envelope's `src`, where an only one has no number."""
    return src if "/" in src else f"{src}/0"
