"""One thread on which all of a service happens: messages, requests, timers."""

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TypeVar

import zenoh

from schemas.message import Message
from schemas.topics import Delivery, Topic
from services.runtime import command
from services.runtime.bus import Bus
from services.runtime.heartbeat import EARLY_S, PERIOD_S, Heartbeat
from services.runtime.inbox import Inbox
from services.runtime.meter import StageMeter
from services.runtime.reader import Received

M = TypeVar("M", bound=Message)


@dataclass(order=True)
class Timer:
    """A call that is due at a time; `cancel` it or let it come."""

    due_s: float
    number: int
    call: Callable[[], None] = field(compare=False)
    cancelled: bool = field(default=False, compare=False)

    def cancel(self) -> None:
        """Do not call."""
        self.cancelled = True


class Loop:
    """Runs a service's handlers one after the other, so that a service needs no locks.

    A message that is not valid is counted by the bus and never reaches a handler; one whose values
    the service's core refuses (a `ValueError`) is counted likewise. Any other exception in a
    handler is a bug and ends the service (its supervisor starts it anew).
    """

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.stages = StageMeter()
        self._inbox: Inbox[Callable[[], None]] = Inbox()
        self._timers: list[Timer] = []
        self._numbers = itertools.count()
        self._stopped = threading.Event()
        self._heartbeat = Heartbeat(bus, self.stages)
        for early_s in EARLY_S:
            self.after(early_s, self._heartbeat.publish)
        self.every(PERIOD_S, self._heartbeat.publish)

    def on(
        self,
        topic: Topic[M],
        handler: Callable[[Received[M]], None],
        camera: int | None = None,
        *,
        every: bool = False,
    ) -> Callable[[], None]:
        """Call `handler` for what arrives: the newest per key, or all in order, as the row says.

        Args:
            topic: What to listen to.
            handler: Called on the loop's thread, with valid messages only.
            camera: Whose, of a topic per camera; None for all.
            every: Take all in order, though the row says that the newest is enough.

        Returns:
            A function that ends the subscription.
        """
        keep_all = every or topic.delivery is Delivery.NEVER_DROP

        def put(key: str, payload: zenoh.ZBytes) -> None:
            if keep_all:
                self._inbox.put_next(topic.key, lambda: take(key, payload))
            else:
                self._inbox.put_latest(key, lambda: take(key, payload))

        def take(key: str, payload: zenoh.ZBytes) -> None:
            received = self.bus.receive(topic, key, payload)
            if received is None:
                return
            try:
                handler(received)
            except (ValueError, ArithmeticError) as error:
                # Well-formed, and yet nothing the service can work with: numbers out of reach.
                self.bus.refuse(key, f"{type(error).__name__}: {error}")

        return self.bus.feed(topic, put, camera, keep_all=keep_all)

    def on_alive(self, service: str, handler: Callable[[str, bool], None]) -> None:
        """Call `handler(instance, alive)` for every instance of `service` that comes or goes."""
        self.bus.presence.watch(
            service,
            lambda instance, alive: self._inbox.put_next(service, lambda: handler(instance, alive)),
        )

    def serve(self, verb: str, handler: command.Handler) -> None:
        """Answer requests for `verb`; what the handler raises becomes the reply's error."""
        key = command.key(self.bus.address, verb)

        def answer(query: zenoh.Query) -> None:
            with query:
                payload = b"" if query.payload is None else query.payload.to_bytes()
                query.reply(key, command.carry_out(key, handler, payload))

        self.bus.serve(key, lambda query: self._inbox.put_next(key, lambda: answer(query)))

    def answer(self, topic: Topic[M], make: Callable[[], M]) -> None:
        """Answer those who fetch a topic that is sent on request only."""
        key = topic.key_for()

        def reply(query: zenoh.Query) -> None:
            with query:
                self.bus.answer(topic, query, make())

        self.bus.serve(key, lambda query: self._inbox.put_next(key, lambda: reply(query)))

    def after(self, delay_s: float, call: Callable[[], None]) -> Timer:
        """Call once, `delay_s` from now; only from the loop's own thread or before `run`."""
        timer = Timer(time.monotonic() + delay_s, next(self._numbers), call)
        heapq.heappush(self._timers, timer)
        return timer

    def every(self, period_s: float, call: Callable[[], None]) -> None:
        """Call each `period_s`, first after one period; a late call does not cause a burst."""

        def again() -> None:
            call()
            self.after(period_s, again)

        self.after(period_s, again)

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Time the block as a stage of this service's work."""
        return self.stages.stage(name)

    def run(self) -> None:
        """Announce the service, then handle what comes until `stop`."""
        self.bus.presence.announce()
        while not self._stopped.is_set():
            due_s = self._timers[0].due_s
            now_s = time.monotonic()
            if due_s <= now_s:
                timer = heapq.heappop(self._timers)
                if not timer.cancelled:
                    timer.call()
                continue
            call = self._inbox.get(due_s - now_s)
            if call is not None:
                call()
        self._heartbeat.publish()

    def stop(self) -> None:
        """End `run` after the handler at hand; from any thread or a signal handler."""
        self._stopped.set()
        self._inbox.close()
