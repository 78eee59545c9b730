"""One thread on which all of a service happens: messages, requests, timers."""

import heapq
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import zenoh

from schemas.message import Message
from schemas.topics import Delivery, Topic
from services.runtime import command, estate
from services.runtime.bus import Bus
from services.runtime.heartbeat import EARLY_S, PERIOD_S, Heartbeat
from services.runtime.inbox import Inbox
from services.runtime.later import Later
from services.runtime.meter import StageMeter
from services.runtime.reader import Received

M = TypeVar("M", bound=Message)

Gate = Callable[[Callable[[], None]], None]
"""Calls what it is given, now or when its time has come, on the loop's thread."""


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
        self._endings: list[Callable[[], None]] = []
        self._worker = ThreadPoolExecutor(1, "later")  # Starts no thread before there is work.
        self._heartbeat = Heartbeat(bus, self.stages)
        for early_s in EARLY_S:
            self.after(early_s, self._heartbeat.publish)
        self.every(PERIOD_S, self._heartbeat.publish)
        self.every(estate.PERIOD_S, estate.Heir().tend)

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

    def serve(self, verb: str, handler: command.Handler, gate: Gate | None = None) -> None:
        """Answer requests for `verb`; what the handler raises becomes the reply's error.

        Args:
            verb: The last part of the key.
            handler: Takes the parameters and returns the result.
            gate: Decides when a request is carried out; at once when None.
        """
        key = command.key(self.bus.address, verb)

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(key, command.carry_out(key, handler, _payload(query), self.bus.refuse))

        def pass_on(query: zenoh.Query) -> None:
            if gate is None:
                answer(query)
            else:
                gate(lambda: answer(query))

        self.bus.serve(key, lambda query: self._inbox.put_next(key, lambda: pass_on(query)))

    def serve_later(self, verb: str, begin: Callable[[dict[str, Any]], Later[Any]]) -> None:
        """Answer requests that take long, one after the other, while messages are handled.

        Args:
            verb: The last part of the key.
            begin: Takes the parameters, on the loop's thread, when the request before is answered;
                what it, the work or the end of the work raises becomes the reply's error.
        """
        key = command.key(self.bus.address, verb)
        queue: deque[zenoh.Query] = deque()  # The first is being worked on.

        def arrive(query: zenoh.Query) -> None:
            queue.append(query)
            if len(queue) == 1:
                begin_first()

        def begin_first() -> None:
            begun: list[Later[Any]] = []

            def check(params: dict[str, Any]) -> dict[str, Any]:
                begun.append(begin(params))
                return {}

            payload = _payload(queue[0])
            refusal = command.carry_out(key, check, payload, self.bus.refuse)
            if not begun:
                finish(refusal)
                return
            later = begun[0]
            done = self._worker.submit(later.work)

            def end(_: dict[str, Any]) -> dict[str, Any]:
                return later.then(done.result())

            def finish_well() -> None:
                finish(command.carry_out(key, end, payload, self.bus.refuse))

            done.add_done_callback(lambda _: self._inbox.put_next(key, finish_well))

        def finish(reply: bytes) -> None:
            with queue.popleft() as query:
                query.reply(key, reply)
            if queue:
                self._inbox.put_next(key, begin_first)

        self.bus.serve(key, lambda query: self._inbox.put_next(key, lambda: arrive(query)))

    def answer(self, topic: Topic[M], make: Callable[[], M | None]) -> None:
        """Answer those who fetch a topic that is sent on request only; None is no answer."""
        key = topic.key_for()

        def reply(query: zenoh.Query) -> None:
            with query:
                if (message := make()) is not None:
                    self.bus.answer(topic, query, message)

        self.bus.serve(key, lambda query: self._inbox.put_next(key, lambda: reply(query)))

    def after(self, delay_s: float, call: Callable[[], None]) -> Timer:
        """Call once, `delay_s` from now; only from the loop's own thread or before `run`."""
        timer = Timer(time.monotonic() + delay_s, next(self._numbers), call)
        heapq.heappush(self._timers, timer)
        return timer

    def every(self, period_s: float, call: Callable[[], object]) -> None:
        """Call each `period_s`, first after one period; a late call does not cause a burst."""

        def again() -> None:
            call()
            self.after(period_s, again)

        self.after(period_s, again)

    def at_end(self, call: Callable[[], None]) -> None:
        """Call when the loop has been stopped, while the bus is still open."""
        self._endings.append(call)

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
        for call in self._endings:
            call()

    def stop(self) -> None:
        """End `run` after the handler at hand; from any thread or a signal handler."""
        self._stopped.set()
        self._inbox.close()


def _payload(query: zenoh.Query) -> bytes:
    return b"" if query.payload is None else query.payload.to_bytes()
