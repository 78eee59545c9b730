"""Requests to a program that has no loop of its own: they wait until it attends to them."""

from collections.abc import Mapping
from queue import Empty, SimpleQueue
from typing import Any

from services.runtime import command
from services.runtime.bus import Bus


class Desk:
    """Serves verbs on `ctl/<service>/<verb>`, on the thread that calls `attend`."""

    def __init__(self, bus: Bus, handlers: Mapping[str, command.Handler]) -> None:
        self._bus, self._handlers = bus, handlers
        self._asked: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        key_of = command.key
        self._stops = [bus.serve(key_of(bus.address, verb), self._put(verb)) for verb in handlers]

    def attend(self) -> None:
        """Carry out and answer all that has been asked."""
        while True:
            try:
                verb, query = self._asked.get_nowait()
            except Empty:
                return
            key, handler = command.key(self._bus.address, verb), self._handlers[verb]
            payload = b"" if query.payload is None else query.payload.to_bytes()
            with query:
                query.reply(key, command.carry_out(key, handler, payload, self._bus.refuse))

    def close(self) -> None:
        """Serve no more."""
        for stop in self._stops:
            stop()

    def _put(self, verb: str) -> Any:
        return lambda query: self._asked.put((verb, query))
