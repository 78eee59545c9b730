"""The bus: publish, subscribe, request and serve messages of the topic table over zenoh."""

import logging
import os
import secrets
import time
from collections.abc import Callable
from typing import Any, Self, TypeVar

import zenoh

from schemas.codec import decode
from schemas.message import Message, MessageError
from schemas.topics import Delivery, Topic, camera_of, find
from services.runtime import command
from services.runtime.drains import Drains
from services.runtime.errors import NoReply
from services.runtime.inbox import Inbox
from services.runtime.linger import no_lingering
from services.runtime.meter import Meters
from services.runtime.presence import Presence
from services.runtime.reader import Reader, Received
from services.runtime.reunion import Reunion
from services.runtime.sender import Sender, is_read
from services.runtime.session import locators, open_peer
from services.runtime.settings import BusSettings
from services.runtime.shared_memory import SharedPool

logger = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)

_ASK_AGAIN_S = 0.05
_WILDCARD_RING = 256  # Four ticks of 64 cameras; the thread that empties it does nothing else.


class Bus:
    """One service's session. Messages are numbered and stamped here and validated on arrival.

    Nothing that a sender does can block or stop a receiver: zenoh's thread only fills a ring, one
    of ours moves samples to an `Inbox`, whoever reads decodes. Close it, best by `with`: an open
    session keeps the interpreter from ending. Others see the service once its loop runs, or
    `presence.announce` is called.
    """

    def __init__(self, settings: BusSettings, service: str, instance: str | None = None) -> None:
        self.address = service if instance is None else f"{service}/{instance}"
        self.boot = secrets.token_hex(4)
        self.pool = SharedPool(settings.shm_pool_mib)
        self.last_refusal = ""
        self._session = open_peer(settings, self.address)
        self._pid = os.getpid()
        self.meters = Meters()
        self._sender = Sender(self._session, self.address, self.boot, self.meters, self.pool)
        self._drains = Drains()
        self.presence = Presence(self._session, self.address, self._drains)
        no_lingering(self._session, self._drains)
        self._reunion = Reunion(self._session, settings, self.address)

    def publish(
        self,
        topic: Topic[M],
        message: M,
        camera: int | None = None,
        service: str | None = None,
    ) -> None:
        """Number, stamp and send a message; a large one that nobody reads is not even packed."""
        self._sender.publish(topic, topic.key_for(camera, service), message)

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

        stop = self.feed(topic, put, camera, keep_all=keep_all)
        return Reader(inbox, lambda item: self.receive(topic, *item), stop)

    def feed(
        self,
        topic: Topic[Any],
        put: Callable[[str, zenoh.ZBytes], None],
        camera: int | None = None,
        *,
        keep_all: bool = False,
    ) -> Callable[[], None]:
        """Call `put(key, payload)` for what arrives, on a thread of ours; return what ends it."""
        expression = topic.expression(camera)
        size = _WILDCARD_RING if keep_all or "*" in expression else 1
        subscriber = self._session.declare_subscriber(expression, zenoh.handlers.RingChannel(size))

        def drain() -> None:
            for sample in subscriber:
                key = str(sample.key_expr)
                if find(key) is topic:
                    put(key, sample.payload)

        self._drains.start(expression, drain)
        return subscriber.undeclare

    def overhear(self, expression: str, put: Callable[[zenoh.Sample], None]) -> Callable[[], None]:
        """Call `put(sample)` for all that is published, valid or not, on zenoh's own thread.

        Nothing is let go before `put` has seen it; it must only take the sample over and return.
        What is returned ends the subscription.
        """
        handler = zenoh.handlers.Callback(put, indirect=False)
        return self._session.declare_subscriber(expression, handler).undeclare

    def republish(self, key: str, payload: bytes) -> bool:
        """Send recorded bytes as they are, as their topic's row says; False: nobody reads them."""
        return self._sender.republish(find(key), key, payload)

    def prepare(self, key: str) -> None:
        """Let those who listen to a key be found before the first is sent there."""
        self._sender.publisher(find(key), key)

    def receive(self, topic: Topic[M], key: str, payload: zenoh.ZBytes) -> Received[M] | None:
        """Decode and count what arrived on `key`; None when it is no valid message of `topic`."""
        meter = self.meters.of(topic, key, sent=False)
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
        meter = self.meters.of(find(key), key, sent=False)
        text, last = f"{key}: {reason}"[:300], self.last_refusal
        self.last_refusal = text  # Before it is counted: whoever sees the count looks here.
        meter.bad += 1
        if meter.bad == 1 or text != last:
            logger.warning("refused %s (%d so far)", text, meter.bad)

    def request(
        self,
        service: str,
        verb: str,
        params: dict[str, Any] | None = None,
        instance: str | None = None,
        timeout_s: float = 2.0,
        find_s: float | None = None,
    ) -> dict[str, Any]:
        """Ask a service and wait for its answer.

        Args:
            service: Whom. verb: What for. params: What more. instance: Which, if there are several.
            timeout_s: How long to wait. find_s: How long to look for who answers; as long if None.

        Raises:
            NoReply: If nobody serves the verb, or not in time.
            CommandFailed: If the service refused; the text is its own.
        """
        key = command.key(service if instance is None else f"{service}/{instance}", verb)
        payload = self._ask(key, timeout_s, command.pack_request(params or {}), find_s)
        return command.unpack_reply(key, payload)

    def fetch(self, topic: Topic[M], timeout_s: float = 5.0) -> M:
        """Ask for a topic that is sent on request only.

        Raises:
            NoReply: If nobody answers in time.
            MessageError: If the answer is no message of the topic.
        """
        message: M = decode(topic.adapter, self.fetch_bytes(topic.key_for(), timeout_s))[1]
        return message

    def fetch_bytes(self, key: str, timeout_s: float = 5.0) -> bytes:
        """Ask for a key that is sent on request only; return the answer as it came.

        Raises:
            NoReply: If nobody answers in time.
        """
        return self._ask(key, timeout_s, None)

    def _ask(
        self, key: str, timeout_s: float, payload: bytes | None, find_s: float | None = None
    ) -> bytes:
        deadline_s = time.monotonic() + timeout_s
        found_s = deadline_s if find_s is None else time.monotonic() + find_s
        # A key that nobody is yet known to serve is answered by silence at once: a service that
        # has just come up needs a moment to be found.
        while (left_s := deadline_s - time.monotonic()) > 0:
            try:
                for reply in self._session.get(key, payload=payload, timeout=left_s):
                    if reply.ok is not None:
                        return reply.ok.payload.to_bytes()
            except zenoh.ZError:  # The session was closed on another thread.
                raise NoReply(f"{key}: the bus was left before an answer came") from None
            if time.monotonic() > found_s:
                break
            time.sleep(min(_ASK_AGAIN_S, left_s))
        raise NoReply(f"{key}: no answer within {timeout_s:g} s; is the service running?")

    def serve(self, key: str, handle: Callable[[zenoh.Query], None]) -> Callable[[], None]:
        """Call `handle` for each query on `key`, on zenoh's thread: only pass it on there."""
        handler = zenoh.handlers.Callback(handle, indirect=False)
        return self._session.declare_queryable(key, handler).undeclare

    def answer(self, topic: Topic[M], query: zenoh.Query, message: M) -> None:
        """Answer a query for a `fetch`ed topic."""
        self._sender.answer(topic, query, message)

    def matching(self, topic: Topic[Any], camera: int | None = None) -> bool:
        """Whether anybody subscribes to what we publish there."""
        return is_read(self._sender.publisher(topic, topic.key_for(camera)))

    def endpoints(self) -> list[str]:
        """Return the locators at which this session can be reached."""
        return locators(self._session)

    def close(self) -> None:
        """Leave the bus; idempotent."""
        if os.getpid() != self._pid:
            return  # A forked child must not touch its parent's session: closing would hang.
        self._reunion.close()
        self._session.close()  # type: ignore[no-untyped-call]
        self._drains.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
