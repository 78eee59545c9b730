"""The router: introduces services to each other; what they say flows between them directly."""

import logging
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from services.runtime.drains import Drains
from services.runtime.linger import no_lingering
from services.runtime.log import start_logging
from services.runtime.service import parse
from services.runtime.session import locators, open_router
from services.runtime.settings import BusSettings, ServiceSettings

logger = logging.getLogger(__name__)


class RouterSettings(ServiceSettings):
    """Host the bus's router; eclipse/zenoh's `zenohd` may take its place."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_ROUTER_"}

    listen: str = "tcp/127.0.0.1:7447"
    """Endpoint; loopback unless told otherwise, port 0 takes a free one."""


@contextmanager
def router(listen: str = "tcp/127.0.0.1:0", settings: BusSettings | None = None) -> Iterator[str]:
    """Host a router and yield the endpoint to connect to; `settings` say whom it lets in."""
    drains = Drains()
    with open_router(listen, settings or BusSettings()) as session:
        no_lingering(session, drains)
        yield next(iter(locators(session)), listen)
    drains.join()


def main(args: Sequence[str] | None = None) -> None:
    """Host a router until SIGINT or SIGTERM."""
    settings = parse(RouterSettings, "router", args)
    start_logging("router", settings.log_level)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with router(settings.listen, settings.bus) as endpoint:
        logger.info("up: %s", endpoint)
        stop.wait()
    logger.info("down")


if __name__ == "__main__":
    main()
