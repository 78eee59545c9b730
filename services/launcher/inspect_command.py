"""`encircle list`, `echo`, `hz`, `bw`, `delay`, `info`, `doctor`: looking at a bus from outside."""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import TypeVar

import tyro

from services.inspector.errors import InspectorError
from services.inspector.settings import (
    DoctorSettings,
    EchoSettings,
    InfoSettings,
    ListSettings,
    LookSettings,
    RateSettings,
)
from services.launcher.errors import LauncherError, SettingsError
from services.runtime.errors import BadExpression, BusUnavailable

S = TypeVar("S", bound=LookSettings)


def list_(args: Sequence[str]) -> int:
    """Carry out `encircle list`."""
    from services.inspector.list_service import list_keys

    return _carry_out(ListSettings, "list", args, lambda s: list_keys(s, _out, _tell))


def echo(args: Sequence[str]) -> int:
    """Carry out `encircle echo`."""
    from services.inspector.echo_service import echo

    terminal = sys.stdout.isatty()
    return _carry_out(EchoSettings, "echo", args, lambda s: echo(s, _out, _tell, terminal=terminal))


def hz(args: Sequence[str]) -> int:
    """Carry out `encircle hz`."""
    return _measure("hz", args)


def bw(args: Sequence[str]) -> int:
    """Carry out `encircle bw`."""
    return _measure("bw", args)


def delay(args: Sequence[str]) -> int:
    """Carry out `encircle delay`."""
    return _measure("delay", args)


def info(args: Sequence[str]) -> int:
    """Carry out `encircle info`."""
    from services.inspector.info_service import info

    return _carry_out(InfoSettings, "info", args, lambda s: info(s, _out, _tell))


def doctor(args: Sequence[str]) -> int:
    """Carry out `encircle doctor`."""
    from services.inspector.doctor_service import doctor

    return _carry_out(DoctorSettings, "doctor", args, lambda s: doctor(s, _out))


def _measure(name: str, args: Sequence[str]) -> int:
    from services.inspector.rates_service import Measure, measure

    what = Measure(name)
    return _carry_out(RateSettings, name, args, lambda s: measure(s, what, _out, _tell))


def _carry_out(kind: type[S], name: str, args: Sequence[str], command: Callable[[S], int]) -> int:
    """Read the settings and run a command; Ctrl-C is how one stops to listen, and no failure.

    Raises:
        SystemExit: If a flag is wrong; tyro has named its rule.
        SettingsError: If a key expression or a field is wrong; the text names value and rule.
        LauncherError: If the bus cannot be joined.
    """
    settings = tyro.cli(kind, prog=f"encircle {name}", args=args)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return command(settings)
    except (InspectorError, BadExpression) as error:
        raise SettingsError(str(error)) from None
    except BusUnavailable as error:
        raise LauncherError(str(error)) from None
    except BrokenPipeError:
        # Whoever read along has seen enough (`| head`); Python would complain of it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return 0


def _out(line: str) -> None:
    print(line, flush=True)


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
