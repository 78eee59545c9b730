"""A router of one's own and as many sessions as a test wants, all in this process."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest

from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.router import router
from services.runtime.settings import BusSettings


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Where a router of this test listens."""
    with router() as where:
        yield where


@pytest.fixture
def open_bus(endpoint: str) -> Iterator[Callable[..., Bus]]:
    """Open a session: `open_bus("camera", "3")`; closed when the test ends.

    With `announce=True` the others see it at once, as they see a service whose loop runs.
    """
    with ExitStack() as stack:

        def open_one(
            service: str,
            instance: str | None = None,
            *,
            announce: bool = False,
            namespace: str = "",
        ) -> Bus:
            settings = BusSettings(connect=endpoint, shm_pool_mib=16, namespace=namespace)
            bus = stack.enter_context(Bus(settings, service, instance))
            if announce:
                bus.presence.announce()
            return bus

        yield open_one


@contextmanager
def running(loop: Loop) -> Iterator[Loop]:
    """Run a loop on a thread for the length of the block."""
    thread = threading.Thread(target=loop.run)
    thread.start()
    try:
        yield loop
    finally:
        loop.stop()
        thread.join(10)
        assert not thread.is_alive()
