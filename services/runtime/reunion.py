"""Finding again whom a session has lost: zenoh makes a link between two peers once."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable

import zenoh
from pydantic import BaseModel, ValidationError

from services.runtime.roles import ROUTERS_WORD

logger = logging.getLogger(__name__)

LOOKS_S = (2.0, 4.0, 8.0, 16.0)
"""After a loss: when it is looked whether the link is back. The lease is 3 s, the flush of a link
that is given up takes another 0.8 s."""
_ASK_S = 1.0


class _Link(BaseModel):
    peer: str


class _RoutersWord(BaseModel):
    """What a router tells of itself; it is more."""

    sessions: list[_Link]


class Reunion:
    """Has the router tell all peers of each other again while a lost one is still there.

    A peer connects to another when the router tells of it. When a network was cut for about as
    long as a lease, the router may be back, and tell, before the dead link to the other has been
    given up: then nobody ever connects them, and both seem well. The router tells all of all
    whenever somebody comes: so `visit` is called, which comes and goes.
    """

    def __init__(self, session: zenoh.Session, visit: Callable[[], None]) -> None:
        self._session, self._visit = session, visit
        self._lost: dict[str, list[float]] = {}
        """Whom we have lost: when to look, monotonic, the next first."""
        self._changed = threading.Condition()
        self._closed = False
        self.num_visits = 0
        self._listener = session.info.declare_transport_events_listener(
            zenoh.handlers.Callback(self._note, indirect=False)
        )
        self._thread = threading.Thread(target=self._run, name="reunion", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no more; before the session is closed."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join(3 * _ASK_S)  # It may be asking, or on a visit.

    def _note(self, event: zenoh.TransportEvent) -> None:
        if event.transport.whatami != zenoh.WhatAmI.PEER:
            return  # Routers are tried again by zenoh itself.
        zid, now_s = str(event.transport.zid), time.monotonic()
        with self._changed:
            self._lost.pop(zid, None)
            if event.kind == zenoh.SampleKind.DELETE:
                self._lost[zid] = [now_s + wait_s for wait_s in LOOKS_S]
            self._changed.notify_all()

    def _run(self) -> None:
        while (due := self._due()) is not None:
            with contextlib.suppress(zenoh.ZError):  # The session is being closed.
                self._look_for(due)

    def _look_for(self, due: list[str]) -> None:
        found = {str(zid) for zid in self._session.info.peers_zid()}
        with self._changed:
            for zid in found:
                self._lost.pop(zid, None)
        missed = [zid for zid in due if zid not in found and self._is_there(zid)]
        if missed and not self._closed:
            logger.info("lost, but there: %s; asking to be told of all again", ", ".join(missed))
            self.num_visits += 1
            self._visit()

    def _due(self) -> list[str] | None:
        """Wait until it is time to look for somebody; None: it is over."""
        with self._changed:
            while not self._closed:
                now_s = time.monotonic()
                due = [zid for zid, looks in self._lost.items() if looks[0] <= now_s]
                for zid in due:
                    self._lost[zid].pop(0)
                    if not self._lost[zid]:
                        del self._lost[zid]
                if due:
                    return due
                next_s = min((looks[0] for looks in self._lost.values()), default=None)
                self._changed.wait(None if next_s is None else next_s - now_s)
        return None

    def _is_there(self, zid: str) -> bool:
        """Whether a router has a session with a peer; if none says anything, it may be."""
        for reply in self._session.get(ROUTERS_WORD, timeout=_ASK_S):
            if reply.ok is None:
                continue
            with contextlib.suppress(ValidationError):
                word = _RoutersWord.model_validate_json(reply.ok.payload.to_bytes())
                return any(each.peer == zid for each in word.sessions)
        return bool(self._session.info.routers_zid())
