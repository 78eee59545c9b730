"""Who already says live what a replay is about to say."""

from collections.abc import Collection

from schemas.topics import SERVICE_STATUS, camera_of, find
from services.runtime.bus import Bus
from services.runtime.tap import Tap

_MAX_BYTES = 1 << 20  # Only the keys count.


class LiveSenders:
    """Listens from the beginning until it is closed; then tells who was there."""

    def __init__(self, bus: Bus, keys: Collection[str]) -> None:
        self._bus, self._keys = bus, keys
        self._tap = Tap(bus, sorted(keys), _MAX_BYTES)

    def close(self) -> tuple[set[str], list[str]]:
        """Listen no longer.

        Returns:
            Keys of heartbeats whose services live and say their own; and what else is said live,
            in words.
        """
        self._tap.close()
        alive = self._bus.presence.everybody()
        owned = {key: owner for key in self._keys if (owner := sender_of(key)) in alive}
        beats = {key for key in owned if find(key) is SERVICE_STATUS}
        heard = self._heard() - beats
        said = {key: f"by {owner}" for key, owner in owned.items() if key not in beats}
        said = {key: "by somebody" for key in heard} | said
        return beats, [f"{key} ({who})" for key, who in sorted(said.items())]

    def _heard(self) -> set[str]:
        heard = set(self._tap.dropped)
        while self._tap.waiting_bytes:
            heard.add(self._tap.get(0).key)
        return heard


def sender_of(key: str) -> str:
    """Return who sends a key by the topic table, as `service/instance`; empty if nobody does."""
    topic = find(key)
    if topic is None:
        return ""
    if topic is SERVICE_STATUS:
        address = key.partition("/")[2]
        return address if "/" in address else f"{address}/0"
    camera = camera_of(key) if topic.sender == "camera" else None
    return f"{topic.sender}/{camera or 0}"
