"""Services as they run, on a bus as it is, that can be fed payload by payload.

Each payload takes the way of what arrives from zenoh, from the subscription's `put` through the
loop's inbox, `Bus.receive` and the handler; only zenoh's own thread is left out, which would pass
over what is replaced by newer.
"""

import heapq
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import zenoh

from schemas.codec import decode, encode
from schemas.message import MessageError
from schemas.topics import MAP_FULL, Topic, camera_of, find
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.settings import BusSettings
from tests.examples import ENVELOPE, EXAMPLES
from tests.fuzz.mutation import Mutator

Put = Callable[[str, zenoh.ZBytes], None]


class TappedBus(Bus):
    """Remembers where each topic's samples go."""

    def __init__(self, settings: BusSettings, service: str) -> None:
        self.puts: dict[str, Put] = {}
        super().__init__(settings, service)

    def feed(
        self, topic: Topic[Any], put: Put, camera: int | None = None, *, keep_all: bool = False
    ) -> Callable[[], None]:
        self.puts[topic.key] = put
        stop = super().feed(topic, put, camera, keep_all=keep_all)

        def end() -> None:
            self.puts.pop(topic.key, None)
            stop()

        return end


class Victim:
    """A service, fed and driven on the caller's thread."""

    def __init__(self, name: str, bus: TappedBus, loop: Loop, service: Any) -> None:
        self.name, self.bus, self.loop, self.service = name, bus, loop, service
        self.num_sent = self.num_bad = self.num_refused = 0
        self.slowest = (0.0, "")

    @property
    def topics(self) -> list[str]:
        """What it listens to."""
        return sorted(self.bus.puts)

    def send(self, key: str, payload: bytes) -> bool:
        """Feed a payload, let the service do all that follows, and check that it was counted.

        Returns:
            Whether it was a valid message of its topic.
        """
        topic = find(key)
        assert topic is not None
        is_valid = _is_valid(topic, key, payload)
        meter = self.bus.meters.of(topic, key, sent=False)
        count, bad = meter.count, meter.bad
        began_s = time.perf_counter()
        self.bus.puts[topic.key](key, zenoh.ZBytes(payload))
        self.settle()
        took_s = time.perf_counter() - began_s
        if took_s > self.slowest[0]:
            self.slowest = took_s, key
        assert meter.count == count + is_valid, f"{key}: {payload!r:.200}"
        if is_valid:
            self.num_refused += meter.bad > bad
        else:
            # More, if a deadline just now had an earlier cloud of this key fused, and refused.
            assert meter.bad > bad, f"{key}: {payload!r:.200}"
            self.num_bad += 1
        self.num_sent += 1
        return is_valid

    def settle(self) -> None:
        """Do what is due and what waits, as the loop does."""
        loop = self.loop
        while True:
            if loop._timers[0].due_s <= time.monotonic():
                timer = heapq.heappop(loop._timers)
                if not timer.cancelled:
                    timer.call()
            elif (call := loop._inbox.get(0.0)) is not None:
                call()
            else:
                return

    @property
    def told_bad(self) -> int:
        """What its heartbeat says."""
        return self.loop._heartbeat.status().bad_messages


def _is_valid(topic: Topic[Any], key: str, payload: bytes) -> bool:
    try:
        _, message = decode(topic.adapter, payload)
    except MessageError:
        return False
    camera = camera_of(key)
    return camera is None or message.camera == camera


@contextmanager
def victims(endpoint: str, wanted: tuple[str, ...], seed: int = 0) -> Iterator[dict[str, Victim]]:
    """Start services on a router."""
    with ExitStack() as stack:
        made = {}
        for name in wanted:
            # Each on its own: what one says must not mix with what another is fed.
            settings = BusSettings(connect=endpoint, shm_pool_mib=16, namespace=name)
            neighbour = stack.enter_context(Bus(settings, "camera", "3"))
            neighbour.presence.announce()
            neighbour.serve(MAP_FULL.key, _tell_map(seed))
            bus = stack.enter_context(TappedBus(settings, name))
            loop = Loop(bus)
            made[name] = Victim(name, bus, loop, _build(name, bus, loop))
            bus.presence.announce()
            stack.callback(lambda each=loop: [call() for call in each._endings])
        if "viewer" in made:
            stack.enter_context(_watched(made["viewer"]))
        yield made


def _tell_map(seed: int) -> Callable[[zenoh.Query], None]:
    """Answer those who missed changes, every other time with rubbish."""
    mutator = Mutator(seed)
    whole = encode(EXAMPLES["map_full"][1], ENVELOPE).join()

    def tell(query: zenoh.Query) -> None:
        with query:
            query.reply(MAP_FULL.key, mutator.mutant(whole).payload if mutator.number(2) else whole)

    return tell


def _build(name: str, bus: Bus, loop: Loop) -> object:
    match name:
        case "mapper":
            from services.mapper.service import MapperService
            from services.mapper.settings import MapperSettings

            return MapperService(MapperSettings(memory="persistent"), bus, loop)
        case "planner":
            from services.planner.service import PlannerService
            from services.planner.settings import PlannerSettings

            return PlannerService(PlannerSettings(), bus, loop)
        case "evaluator":
            from services.evaluator.service import EvaluatorService
            from services.evaluator.settings import EvaluatorSettings

            return EvaluatorService(EvaluatorSettings(samples=1000), bus, loop)
        case _:
            from services.viewer.service import ViewerService
            from services.viewer.settings import ViewerSettings

            return ViewerService(ViewerSettings(port=18080, rate_hz=30.0), bus, loop)


@contextmanager
def _watched(viewer: Victim) -> Iterator[None]:
    """Open the page, so that the viewer listens to all that it can."""
    from websockets.exceptions import ConnectionClosed

    from tests.integration.viewer_browser import browsing

    with browsing(viewer.service.web.port) as browser:
        connection = browser._connection

        def read() -> None:
            try:
                while True:
                    connection.recv()
            except ConnectionClosed:
                return

        thread = threading.Thread(target=read, daemon=True)
        thread.start()
        until_s = time.monotonic() + 20.0
        while len(viewer.topics) < 5:
            assert time.monotonic() < until_s, "the viewer never listened"
            viewer.settle()
        yield
        connection.close()
        thread.join(5.0)
