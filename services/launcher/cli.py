"""`encircle`: the command line. Nothing is imported before it is known what is asked."""

import sys
from collections.abc import Sequence

_SERVICES = {
    "simulator": "the world: a target that moves and deforms, the cameras' bodies",
    "camera": "one depth camera",
    "planner": "where the cameras go next",
    "mapper": "all clouds of an instant into one map",
    "evaluator": "the map against the truth",
    "router": "introduces the services to each other",
}
EXIT_FAILED, EXIT_USAGE = 1, 2


def main() -> None:
    """Entry point of the console script."""
    sys.exit(dispatch(sys.argv[1:]))


def dispatch(args: Sequence[str]) -> int:
    """Carry out a command line and return the exit code."""
    match args:
        case [] | ["-h" | "--help", *_]:
            print(_help())
            return 0
        case ["--version", *_]:
            from importlib.metadata import version

            print(version("encircle"))
            return 0
        case ["run", *rest]:
            return _run(rest)
        case [service, *rest] if service in _SERVICES:
            return _serve(service, rest)
        case _:
            known = ", ".join(("run", *_SERVICES))
            print(f"encircle: no command {args[0]!r}; known: {known}", file=sys.stderr)
            return EXIT_USAGE


def _help() -> str:
    rows = "\n".join(f"  {name:<10} {what}" for name, what in _SERVICES.items())
    return f"""\
encircle: many depth cameras, one live 3D model.

  run        everything below, one process each, with a live table and a report

one service alone, to be joined by others:
{rows}

`encircle COMMAND --help` tells its flags; `encircle --version` the version."""


def _run(args: Sequence[str]) -> int:
    import os

    from rich.console import Console

    from services.launcher.errors import LauncherError, SettingsError
    from services.launcher.flags import parse_run

    console = Console(highlight=False, soft_wrap=True)
    try:
        settings = parse_run(args, os.environ)
        from services.launcher.run import run

        return run(settings, console)
    except SettingsError as error:
        print(f"encircle run: {error}", file=sys.stderr)
        return EXIT_USAGE
    except LauncherError as error:
        print(f"encircle run: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        return 130


def _serve(service: str, args: Sequence[str]) -> int:
    import runpy

    module = "services.runtime.router" if service == "router" else f"services.{service}"
    sys.argv = [f"encircle {service}", *args]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=False)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] in ("services", "schemas"):
            raise
        extra = service if service in ("simulator", "camera", "evaluator") else "all"
        print(
            f"encircle {service}: {error.name} is not installed; pip install 'encircle[{extra}]'",
            file=sys.stderr,
        )
        return EXIT_USAGE
    return 0
