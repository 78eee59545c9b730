"""How a service process lives: settings, log, signals, bus, loop, and a clean end."""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

import tyro
from pydantic import ValidationError

from services.runtime.bus import Bus
from services.runtime.errors import BusUnavailable, MissingExtra, SettingsRefused
from services.runtime.log import start_logging
from services.runtime.loop import Loop
from services.runtime.settings import ServiceSettings

logger = logging.getLogger(__name__)

S = TypeVar("S", bound=ServiceSettings)

EXIT_SETTINGS = 2  # The supervisor does not restart what cannot be mended by a restart.


def main(
    settings_type: type[S],
    service: str,
    build: Callable[[S, Bus, Loop], object],
    args: Sequence[str] | None = None,
    prepare: Callable[[], None] = lambda: None,
    command: str | None = None,
) -> None:
    """Run one service until SIGINT or SIGTERM.

    Args:
        settings_type: Its settings; read from the environment, then from the flags.
        service: Its name on the bus.
        build: Makes the service: subscribes on the loop, returns the object to keep.
        args: Command line; that of the process when None.
        command: How it is called on the command line, if not by its name.
        prepare: What takes a moment: called once the settings are good, before the bus knows us.
    """
    settings = parse(settings_type, command or service, args)
    prepare()
    instance = settings.instance()
    start_logging(service if instance is None else f"{service}/{instance}", settings.log_level)
    try:
        with Bus(settings.joining(), service, instance) as bus:
            run(settings, bus, build)
    except (MissingExtra, BusUnavailable, SettingsRefused) as error:
        logger.error("%s", error)
        sys.exit(EXIT_SETTINGS)
    # The bus is closed and the log is out. Taking LLVM and the libraries' threads apart costs
    # 0.3 s and more of each process, all at once when a system stops, and mends nothing.
    logging.shutdown()
    os._exit(0)


def parse(settings_type: type[S], service: str, args: Sequence[str] | None) -> S:
    """Read settings: default < environment < flag; a wrong one ends with its rule."""
    try:
        return tyro.cli(
            settings_type,
            prog=f"encircle {service}",
            description=settings_type.__doc__,
            default=settings_type(),
            args=args,
        )
    except ValidationError as error:
        for fault in error.errors(include_url=False):
            where = ".".join(str(part) for part in fault["loc"]) or "settings"
            sys.stderr.write(f"{service}: {where}: {fault['msg']} (got {fault['input']!r:.80})\n")
        sys.exit(EXIT_SETTINGS)


def run(settings: S, bus: Bus, build: Callable[[S, Bus, Loop], object]) -> None:
    """Build a service on a bus and run its loop until a signal stops it."""
    loop = Loop(bus)
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.stop())
    try:
        service = build(settings, bus, loop)
    except ValueError as error:  # The core's word on settings that are each valid: not a crash.
        raise SettingsRefused(f"{type(error).__name__}: {error}") from error
    logger.info("up: %s", settings.model_dump_json(exclude={"bus"}))
    loop.run()
    del service
    logger.info("down")
