"""The sending half of a session: numbers, stamps and packs messages, by shared memory if it can."""

import time
from typing import Any, TypeVar

import zenoh

from schemas.codec import Encoded, encode
from schemas.message import Envelope, Message
from schemas.topics import Topic
from services.runtime.meter import Meters
from services.runtime.shared_memory import SharedPool

M = TypeVar("M", bound=Message)
_MOST_NAMED = 48  # Letters; zenoh panics beyond 255 bytes of an encoding.


class Sender:
    """Publishes under one address; `boot` tells its readers a restart from a loss."""

    def __init__(
        self, session: zenoh.Session, address: str, boot: str, meters: Meters, pool: SharedPool
    ) -> None:
        self._session = session
        self._address = address
        self._boot = boot
        self._meters = meters
        self._pool = pool
        self._publishers: dict[str, zenoh.Publisher] = {}

    def publish(self, topic: Topic[M], key: str, message: M) -> None:
        """Send a message; a large one that nobody reads is not even packed."""
        publisher = self.publisher(topic, key)
        if topic.shared_memory and not is_read(publisher):
            return
        encoded = self._number(topic, key, message)
        payload = self._pool.wrap(encoded) if topic.shared_memory else None
        if payload is not None:
            self._meters.of(topic, key, sent=True).shared_memory += 1
        publisher.put(encoded.join() if payload is None else payload)

    def republish(self, topic: Topic[Any] | None, key: str, payload: bytes) -> bool:
        """Send bytes as they are: the way of their topic, none of our numbers.

        Returns:
            Whether they were sent; what is large is not, while nobody reads it.
        """
        publisher = self.publisher(topic, key)
        large = topic is not None and topic.shared_memory
        if large and not is_read(publisher):
            return False
        meter = self._meters.of(topic, key, sent=True)
        meter.tick(time.monotonic())
        chunk = self._pool.wrap(Encoded(b"", payload)) if large else None
        if chunk is not None:
            meter.shared_memory += 1
        publisher.put(payload if chunk is None else chunk)
        return True

    def answer(self, topic: Topic[M], query: zenoh.Query, message: M) -> None:
        """Send a message to the one who asked for it."""
        key = topic.key_for()
        query.reply(key, self._number(topic, key, message).join())

    def publisher(self, topic: Topic[Any] | None, key: str) -> zenoh.Publisher:
        """Return the key's publisher, declared at its first use."""
        publisher = self._publishers.get(key)
        if publisher is None:
            large = topic is not None and topic.shared_memory
            publisher = self._publishers[key] = self._session.declare_publisher(
                key,
                encoding=f"application/msgpack;{key.rsplit('/', 1)[-1][:_MOST_NAMED]}/1",
                # A receiver that does not keep up must never stop its sender; what is lost shows
                # in the numbering, and `map/full` heals the one stream that needs all.
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA if large else zenoh.Priority.INTERACTIVE_HIGH,
                express=not large,
            )
        return publisher

    def _number(self, topic: Topic[M], key: str, message: M) -> Encoded:
        meter = self._meters.of(topic, key, sent=True)
        envelope = Envelope(
            seq=meter.count, src=self._address, boot=self._boot, t_pub_ns=time.time_ns()
        )
        meter.tick(time.monotonic())
        return encode(message, envelope)


def is_read(publisher: zenoh.Publisher) -> bool:
    """Whether anybody subscribes to what the publisher sends."""
    # zenoh's stub says `bool`; the object has the flag.
    return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]
