"""Gathers facts about the bus: heartbeats, the clock, who is alive, whether the router answers."""

import time
from collections.abc import Sequence
from typing import Self

from schemas.message import MessageError
from schemas.sim import SimClock
from schemas.status import ServiceStatus
from schemas.topics import SERVICE_STATUS, SIM_CLOCK
from services.inspector.description import describe
from services.inspector.facts import Beat, Facts, RouterFacts, address_of
from services.inspector.header import read_header
from services.runtime.bus import Bus
from services.runtime.errors import BusUnavailable
from services.runtime.probe import ask_router, listens
from services.runtime.settings import BusSettings
from services.runtime.tap import Sample, Tap

_MAX_BYTES = 16 << 20
RECENT_S = 5.0
"""Older heartbeats tell of services that may be gone."""


def ask_for_router(settings: BusSettings) -> RouterFacts:
    """Find out whether the router takes a new session; 3 s at most."""
    if not listens(settings.connect):
        return RouterFacts(fault="nobody listens", refused=True)
    try:
        answer = ask_router(settings, "inspector")
    except BusUnavailable as error:
        return RouterFacts(fault=str(error))
    return RouterFacts(
        seconds=answer.seconds,
        version=answer.version.partition("-")[0].lstrip("v"),
        sessions=answer.sessions,
    )


class Witness:
    """Listens beside a tool, at next to no cost, so that it knows why when nothing comes."""

    def __init__(
        self,
        bus: Bus,
        settings: BusSettings,
        also: Sequence[str] = (),
        recent_s: float = RECENT_S,
    ) -> None:
        """Start to listen.

        Args:
            bus: To listen on. settings: Its own.
            also: Further key expressions whose stamps are held against our clock.
            recent_s: What came longer ago is forgotten.
        """
        self._recent_ns = round(recent_s * 1e9)
        self._bus = bus
        self._settings = settings
        self._tap = Tap(bus, [SERVICE_STATUS.expression(), SIM_CLOCK.key, *also], _MAX_BYTES)
        self._samples: list[Sample] = []

    def facts(self, router: RouterFacts | None = None) -> Facts:
        """Tell what has been found out, and ask who is there; takes up to a second, and up to 3
        more when the router is not given and does not answer."""
        self._drain()
        beats: dict[str, list[Beat]] = {}
        clocks: list[SimClock] = []
        delays_s: dict[str, float] = {}
        for sample in self._samples:
            try:
                header = read_header(sample.payload)
            except MessageError:
                continue
            address = address_of(header.src)
            delay_s = (sample.received_ns - header.t_pub_ns) * 1e-9
            delays_s[address] = min(delay_s, delays_s.get(address, delay_s))
            if sample.key != SIM_CLOCK.key and not sample.key.startswith("metrics/"):
                continue
            match describe(sample.key, sample.payload).message:
                case ServiceStatus() as status:
                    beats.setdefault(address, []).append(Beat(status, header.t_pub_ns))
                case SimClock() as clock:
                    clocks.append(clock)
        return Facts(
            connect=self._settings.connect,
            router=ask_for_router(self._settings) if router is None else router,
            alive=frozenset(self._bus.presence.everybody()),
            beats={address: tuple(each) for address, each in beats.items()},
            clocks=tuple(clocks),
            delays_s=delays_s,
        )

    def close(self) -> None:
        """Stop to listen."""
        self._tap.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _drain(self) -> None:
        try:
            while True:
                self._samples.append(self._tap.get(0))
        except TimeoutError:
            oldest_ns = time.time_ns() - self._recent_ns
            self._samples = [each for each in self._samples if each.received_ns >= oldest_ns]
