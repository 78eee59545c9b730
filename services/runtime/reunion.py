"""Finding again whom a session has lost or never met: zenoh links two peers once."""

import contextlib
import logging
import random
import threading
import time
from dataclasses import dataclass

import zenoh
from pydantic import BaseModel, ValidationError

from services.runtime.errors import BusUnavailable
from services.runtime.roles import ROUTERS_WORD
from services.runtime.session import introduce, outside
from services.runtime.settings import BusSettings

logger = logging.getLogger(__name__)

WAITS_S = (1.0, 1.0, 2.0, 4.0, 8.0, 16.0, 60.0)
"""After a change of our links, when it is looked who is missing, and when again while one is: the
second look and all that follow do something about it, the last wait is repeated."""
_ASK_S = 1.0
_JITTER = 0.2  # Share of a wait: who lost each other at once does not look at once.


class _Link(BaseModel):
    peer: str
    whatami: str


class _RoutersWord(BaseModel):
    """What a router tells of itself; it is more."""

    sessions: list[_Link]


@dataclass
class _Absence:
    """One that the router has and we have not."""

    num_looks: int
    due_s: float
    """Monotonic."""


class Reunion:
    """Introduces us anew to those whom the router has and to whom we have no link.

    A peer connects to another when it is told of it, and is told by the router or another peer
    when that one gets a link: once. If that attempt fails, or only the link between the two breaks,
    nobody ever connects them, and both seem well. Then we `introduce` ourselves again: a guest
    among the peers makes known to each other all that it meets.
    """

    def __init__(self, session: zenoh.Session, settings: BusSettings, address: str) -> None:
        self._session, self._settings, self._address = session, settings, address
        self._absent: dict[str, _Absence] = {}
        self._look_s: float | None = time.monotonic() + WAITS_S[0]
        """When to look next, monotonic; None: when a link changes."""
        self._changed, self._closing = threading.Condition(), threading.Event()
        self._listener = session.info.declare_transport_events_listener(
            zenoh.handlers.Callback(self._note, indirect=False)
        )
        self._thread = threading.Thread(target=self._run, name="reunion", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no more; before the session is closed."""
        self._closing.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(3 * _ASK_S)  # It may be asking.

    def _note(self, _: zenoh.TransportEvent) -> None:
        with self._changed:
            self._plan(time.monotonic() + WAITS_S[0])
            self._changed.notify_all()

    def _plan(self, look_s: float) -> None:
        self._look_s = look_s if self._look_s is None else min(self._look_s, look_s)

    def _run(self) -> None:
        while self._is_due():
            with contextlib.suppress(zenoh.ZError):  # The session is being closed.
                self._look()

    def _is_due(self) -> bool:
        """Wait until it is time to look; False: it is over."""
        with self._changed:
            while not self._closing.is_set():
                now_s = time.monotonic()
                if self._look_s is not None and self._look_s <= now_s:
                    self._look_s = None
                    return True
                self._changed.wait(None if self._look_s is None else self._look_s - now_s)
        return False

    def _look(self) -> None:
        there = self._routers_peers()
        if there is None:
            return  # Its return changes our links.
        info = self._session.info
        missing = there - {str(zid) for zid in (info.zid(), *info.peers_zid())}
        now_s = time.monotonic()
        self._absent = {zid: self._absent.get(zid) or _Absence(0, now_s) for zid in sorted(missing)}
        due = [zid for zid, absence in self._absent.items() if absence.due_s <= now_s]
        known = [zid for zid in due if self._absent[zid].num_looks > 0]
        if known and not self._closing.is_set():
            logger.info("not linked, but there: %s; introducing us again", ", ".join(known))
            introduce(self._settings, self._address, known, self._closing)
        for zid in due:
            self._absent[zid].num_looks += 1
            wait_s = WAITS_S[min(self._absent[zid].num_looks, len(WAITS_S) - 1)]
            jitter = 1.0 + random.uniform(0.0, _JITTER)
            self._absent[zid].due_s = time.monotonic() + wait_s * jitter
        if self._absent:
            with self._changed:
                self._plan(min(absence.due_s for absence in self._absent.values()))

    def _routers_peers(self) -> set[str] | None:
        """Return whom our routers have a link with; None if none says."""
        ours = {f"@/{zid}/router" for zid in self._session.info.routers_zid()}
        found: set[str] | None = None
        asking = outside(self._session, self._settings, self._address)
        with contextlib.suppress(BusUnavailable), asking as session:
            for reply in session.get(ROUTERS_WORD, timeout=_ASK_S):
                if reply.ok is None or str(reply.ok.key_expr) not in ours:
                    continue
                with contextlib.suppress(ValidationError):
                    word = _RoutersWord.model_validate_json(reply.ok.payload.to_bytes())
                    peers = {each.peer for each in word.sessions if each.whatami == "peer"}
                    found = peers | (found or set())
        return found
