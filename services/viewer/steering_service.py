"""Requests to other services, and what they report of themselves, on a thread of its own."""

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from schemas.map import MapFull
from schemas.message import MessageError
from schemas.topics import MAP_FULL
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed, NoReply
from services.runtime.inbox import Inbox
from services.viewer.controls import POLLED

logger = logging.getLogger(__name__)

POLL_PERIOD_S = 1.0
FULL_PERIOD_S = 0.3
_GET_TIMEOUT_S = 0.5
_END_TIMEOUT_S = 1.0
_SET_TIMEOUT_S = 15.0
"""A large mesh file takes the simulator a while."""
_NEWEST_ONLY = ("set", "seek")
"""Verbs of which the last says all; each click of any other counts."""
_BAD_PARAMS = (ValueError, ArithmeticError, TypeError)
"""What packing raises for what no request can carry."""

Refused = Callable[[str, str], None]
"""Told the service and its own words."""


class SteeringService:
    """Asks, and keeps what was answered; whoever draws never waits for an answer.

    Args:
        bus: The viewer's.
        alive: Returns the services that are there; who is not is not waited for.
        watched: Whether anybody looks: if not, nobody is asked.
        wants_full: Whether the whole map, with its probabilities, is wanted.
    """

    def __init__(
        self,
        bus: Bus,
        alive: Callable[[], frozenset[str]],
        watched: Callable[[], bool],
        wants_full: Callable[[], bool],
    ) -> None:
        self._bus, self._alive, self._watched = bus, alive, watched
        self._wants_full = wants_full
        self._inbox: Inbox[Callable[[], None]] = Inbox()
        self.reports: dict[str, dict[str, Any]] = {}
        """By service, replaced and never changed, for other threads to read."""
        self.full: MapFull | None = None
        self.first: MapFull | None = None
        """The map as it was when it was last asked for; to be taken away."""
        self._lacks_first = False
        self._thread = threading.Thread(target=self._run, name="steering", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def fetch_first(self) -> None:
        """Get the whole map once, into `first`: while a run is paused nobody sends it."""
        self._lacks_first, self.first = True, None

    def stop(self) -> None:
        """Ask no more; whatever is still being asked is not waited for long."""
        self._inbox.close()
        self._thread.join(_END_TIMEOUT_S)

    def ask(self, service: str, verb: str, params: dict[str, Any], refused: Refused) -> None:
        """Send a request from any thread, in turn; of those that wait to set the same, the newest.

        Args:
            service: Who is asked.
            verb: For what.
            params: By name.
            refused: Told if it is not done.
        """

        def call() -> None:
            self._carry_out(service, verb, params, refused)

        if verb in _NEWEST_ONLY:
            self._inbox.put_latest(f"{service}/{verb}/{','.join(sorted(params))}", call)
        else:
            self._inbox.put_next("clicks", call)

    def _carry_out(self, service: str, verb: str, params: dict[str, Any], refused: Refused) -> None:
        if service not in self._alive():
            refused(service, f"no {service} is running; start it: encircle {service}")
            return
        try:
            self._bus.request(service, verb, params, timeout_s=_SET_TIMEOUT_S)
        except (CommandFailed, NoReply, *_BAD_PARAMS) as error:
            logger.info("%s refused: %s", service, error)
            refused(service, str(error))
        self._poll(service)

    def _run(self) -> None:
        poll_s = full_s = time.monotonic()
        while not self._inbox.closed:
            call = self._inbox.get(max(0.0, min(poll_s, full_s) - time.monotonic()))
            if call is not None:
                call()
                continue
            if time.monotonic() >= full_s:
                self.full = self._fetch_full() if self._wants_full() else None
                lacks = self._lacks_first and self._watched()
                if lacks and (first := self.full or self._fetch_full()) is not None:
                    self.first, self._lacks_first = first, False
                full_s = time.monotonic() + FULL_PERIOD_S
            if time.monotonic() >= poll_s:
                for service in POLLED if self._watched() else ():
                    self._poll(service)
                poll_s = time.monotonic() + POLL_PERIOD_S

    def _poll(self, service: str) -> None:
        answer: dict[str, Any] | None = None
        if service in self._alive() and not self._inbox.closed:
            answer = self.reports.get(service)  # One that is busy still is what it said.
            try:
                answer = self._bus.request(service, "get", timeout_s=_GET_TIMEOUT_S)
            except (CommandFailed, NoReply) as error:
                logger.debug("%s", error)
        others = {name: report for name, report in self.reports.items() if name != service}
        self.reports = others if answer is None else {**others, service: answer}

    def _fetch_full(self) -> MapFull | None:
        if "mapper" not in self._alive():
            return None
        try:
            return self._bus.fetch(MAP_FULL, POLL_PERIOD_S)
        except (NoReply, MessageError) as error:
            logger.debug("%s", error)
            return None
