"""The bus: publish, subscribe, request and serve messages of the topic table over zenoh."""

import logging
import os
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Self, TypeVar

import zenoh

from schemas.codec import decode, encode
from schemas.message import Envelope, Message, MessageError
from schemas.topics import Delivery, Topic, camera_of, find
from services.runtime import command
from services.runtime.errors import NoReply
from services.runtime.inbox import Inbox
from services.runtime.meter import TopicMeter
from services.runtime.reader import Reader, Received
from services.runtime.session import locators, open_peer
from services.runtime.settings import BusSettings
from services.runtime.shared_memory import SharedPool

logger = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)

_WILDCARD_RING = 256  # Four ticks of 64 cameras; the thread that empties it does nothing else.
_ALIVE = "alive"


class Bus:
    """One service's session. Messages are numbered and stamped here and validated on arrival.

    Nothing that a sender does can block or stop a receiver: zenoh's thread only fills a ring, a
    thread of ours moves samples to an `Inbox`, and whoever reads decodes. Close it, best by
    `with`: an open session keeps the interpreter from ending.
    """

    def __init__(self, settings: BusSettings, service: str, instance: str | None = None) -> None:
        self.address = service if instance is None else f"{service}/{instance}"
        self.boot = secrets.token_hex(4)
        self.pool = SharedPool(settings.shm_pool_mib)
        self.last_refusal = ""
        self._session = open_peer(settings)
        self._pid = os.getpid()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._meters: dict[tuple[str, bool], TopicMeter] = {}
        self._lock = threading.Lock()
        alive_key = f"{_ALIVE}/{service}/{instance or 0}"
        self._token = self._session.liveliness().declare_token(alive_key)

    def publish(
        self,
        topic: Topic[M],
        message: M,
        camera: int | None = None,
        service: str | None = None,
    ) -> None:
        """Number, stamp and send a message; a large one that nobody reads is not even packed."""
        key = topic.key_for(camera, service)
        publisher = self._publishers.get(key) or self._declare(topic, key)
        if topic.shared_memory and not _is_read(publisher):
            return
        meter = self.meter(key, topic.rate_hz, sent=True)
        envelope = Envelope(
            seq=meter.count, src=self.address, boot=self.boot, t_pub_ns=time.time_ns()
        )
        encoded = encode(message, envelope)
        payload = self.pool.wrap(encoded) if topic.shared_memory else None
        meter.tick(time.monotonic(), shared_memory=payload is not None)
        publisher.put(encoded.join() if payload is None else payload)

    def subscribe(self, topic: Topic[M], camera: int | None = None) -> Reader[M]:
        """Read a topic as its row says: the newest per key, or all in order."""
        keep_all = topic.delivery is Delivery.NEVER_DROP
        return self._reader(topic, camera, keep_all=keep_all)

    def latest(self, topic: Topic[M], camera: int | None = None) -> Reader[M]:
        """Read only the newest of each key."""
        return self._reader(topic, camera, keep_all=False)

    def every(self, topic: Topic[M], camera: int | None = None) -> Reader[M]:
        """Read all that comes, in order (up to the inbox's bound)."""
        return self._reader(topic, camera, keep_all=True)

    def _reader(self, topic: Topic[M], camera: int | None, *, keep_all: bool) -> Reader[M]:
        inbox: Inbox[tuple[str, zenoh.ZBytes]] = Inbox()

        def put(key: str, payload: zenoh.ZBytes) -> None:
            if keep_all:
                inbox.put_next(topic.key, (key, payload))
            else:
                inbox.put_latest(key, (key, payload))

        stop = self.feed(topic, put, camera)
        return Reader(inbox, lambda item: self.receive(topic, *item), stop)

    def feed(
        self, topic: Topic[Any], put: Callable[[str, zenoh.ZBytes], None], camera: int | None = None
    ) -> Callable[[], None]:
        """Call `put(key, payload)` for whatever arrives, on a thread of its own.

        Returns:
            A function that ends the subscription.
        """
        expression = topic.expression(camera)
        size = _WILDCARD_RING if "*" in expression or _in_order(topic) else 1
        subscriber = self._session.declare_subscriber(expression, zenoh.handlers.RingChannel(size))

        def drain() -> None:
            for sample in subscriber:
                key = str(sample.key_expr)
                if find(key) is topic:
                    put(key, sample.payload)

        threading.Thread(target=drain, name=expression, daemon=True).start()
        return subscriber.undeclare

    def receive(self, topic: Topic[M], key: str, payload: zenoh.ZBytes) -> Received[M] | None:
        """Decode and count what arrived on `key`; None when it is no valid message of `topic`."""
        meter = self.meter(key, topic.rate_hz, sent=False)
        by_shm = topic.shared_memory and payload.as_shm() is not None
        try:
            envelope, message = decode(topic.adapter, payload.to_bytes())
        except MessageError as error:
            self.refuse(key, str(error))
            return None
        camera = camera_of(key)
        if camera is not None and message.camera != camera:
            self.refuse(key, f"camera is {message.camera}; the key says {camera}")
            return None
        meter.tick(time.monotonic(), shared_memory=by_shm)
        meter.follow(envelope)
        return Received(key, camera, envelope, message, time.time_ns())

    def refuse(self, key: str, reason: str) -> None:
        """Count a message that was not accepted, and log the first of each key and reason."""
        topic = find(key)
        meter = self.meter(key, topic.rate_hz if topic else 0.0, sent=False)
        meter.bad += 1
        text = f"{key}: {reason}"[:300]
        if meter.bad == 1 or text != self.last_refusal:
            logger.warning("refused %s (%d so far)", text, meter.bad)
        self.last_refusal = text

    def request(
        self,
        service: str,
        verb: str,
        params: dict[str, Any] | None = None,
        instance: str | None = None,
        timeout_s: float = 2.0,
    ) -> dict[str, Any]:
        """Ask a service and wait for its answer.

        Raises:
            NoReply: If nobody serves the verb, or not in time.
            CommandFailed: If the service refused; the text is its own.
        """
        key = command.key(service if instance is None else f"{service}/{instance}", verb)
        payload = self._ask(key, timeout_s, command.pack_request(params or {}))
        return command.unpack_reply(key, payload)

    def fetch(self, topic: Topic[M], timeout_s: float = 5.0) -> M:
        """Ask for a topic that is sent on request only.

        Raises:
            NoReply: If nobody answers in time.
            MessageError: If the answer is no message of the topic.
        """
        message: M = decode(topic.adapter, self._ask(topic.key_for(), timeout_s, None))[1]
        return message

    def _ask(self, key: str, timeout_s: float, payload: bytes | None) -> bytes:
        for reply in self._session.get(key, payload=payload, timeout=timeout_s):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        raise NoReply(f"{key}: no answer within {timeout_s:g} s; is the service running?")

    def serve(self, key: str, handle: Callable[[zenoh.Query], None]) -> Callable[[], None]:
        """Call `handle` for each query on `key`, on zenoh's thread: only pass it on there."""
        handler = zenoh.handlers.Callback(handle, indirect=False)
        return self._session.declare_queryable(key, handler).undeclare

    def answer(self, topic: Topic[M], query: zenoh.Query, message: M) -> None:
        """Answer a query for a `fetch`ed topic."""
        key = topic.key_for()
        meter = self.meter(key, topic.rate_hz, sent=True)
        envelope = Envelope(
            seq=meter.count, src=self.address, boot=self.boot, t_pub_ns=time.time_ns()
        )
        meter.tick(time.monotonic())
        query.reply(key, encode(message, envelope).join())

    def watch_alive(self, service: str, put: Callable[[str, bool], None]) -> Callable[[], None]:
        """Call `put(instance, alive)` for every instance of a service that comes or goes."""
        subscriber = self._session.liveliness().declare_subscriber(
            f"{_ALIVE}/{service}/*", zenoh.handlers.RingChannel(_WILDCARD_RING), history=True
        )

        def drain() -> None:
            for sample in subscriber:
                put(str(sample.key_expr).rsplit("/", 1)[1], sample.kind is zenoh.SampleKind.PUT)

        threading.Thread(target=drain, name=f"{_ALIVE}/{service}", daemon=True).start()
        return subscriber.undeclare

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Return who is on the bus, as `service/instance`."""
        replies = self._session.liveliness().get(f"{_ALIVE}/*/*", timeout=timeout_s)
        keys = (str(reply.ok.key_expr) for reply in replies if reply.ok is not None)
        return {key.removeprefix(f"{_ALIVE}/") for key in keys}

    def matching(self, topic: Topic[Any], camera: int | None = None) -> bool:
        """Whether anybody subscribes to what we publish there."""
        key = topic.key_for(camera)
        publisher = self._publishers.get(key) or self._declare(topic, key)
        return _is_read(publisher)

    def endpoints(self) -> list[str]:
        """Return the locators at which this session can be reached."""
        return locators(self._session)

    def meter(self, key: str, declared_hz: float, *, sent: bool) -> TopicMeter:
        """Return the figures of one stream, begun at its first use."""
        with self._lock:
            meter = self._meters.get((key, sent))
            if meter is None:
                meter = self._meters[key, sent] = TopicMeter(key, declared_hz, sent=sent)
            return meter

    def meters(self) -> Iterator[TopicMeter]:
        """Iterate over all streams this session has sent or received."""
        with self._lock:
            meters = list(self._meters.values())
        yield from meters

    def close(self) -> None:
        """Leave the bus; idempotent."""
        if os.getpid() != self._pid:
            return  # A forked child must not touch its parent's session: closing would hang.
        self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _declare(self, topic: Topic[Any], key: str) -> zenoh.Publisher:
        large = topic.shared_memory
        publisher = self._session.declare_publisher(
            key,
            encoding=f"application/msgpack;{key.rsplit('/', 1)[-1]}/1",
            # A receiver that does not keep up must never stop its sender; what is lost shows
            # in the numbering, and `map/full` heals the one stream that needs all.
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA if large else zenoh.Priority.INTERACTIVE_HIGH,
            express=not large,
        )
        self._publishers[key] = publisher
        return publisher


def _is_read(publisher: zenoh.Publisher) -> bool:
    # zenoh's stub says `bool`; the object has the flag.
    return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]


def _in_order(topic: Topic[Any]) -> bool:
    return topic.delivery is Delivery.NEVER_DROP
