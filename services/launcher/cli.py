"""`encircle`: the command line. Nothing is imported before it is known what is asked."""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NamedTuple


class _Command(NamedTuple):
    where: str
    """`module:function`; the function takes the arguments and returns the exit code."""
    about: str


_COMMANDS = {
    "run": _Command(
        "services.launcher.run_command:run",
        "every service, one process each, with a live table and a report",
    ),
    "convert": _Command(
        "services.launcher.convert:convert",
        "a saved map into another format: .npz .ot .bt .ply .obj .glb",
    ),
    "plan": _Command(
        "services.launcher.plan_command:plan",
        "whether a formation sees its target and can be driven; --plot draws it",
    ),
    "list": _Command(
        "services.launcher.inspect_command:list_",
        "every key of the bus: declared and seen rates, sizes, senders",
    ),
    "echo": _Command("services.launcher.inspect_command:echo", "what is said on a key"),
    "hz": _Command("services.launcher.inspect_command:hz", "how often a key is sent"),
    "bw": _Command("services.launcher.inspect_command:bw", "how many bytes per second"),
    "delay": _Command("services.launcher.inspect_command:delay", "how late it comes"),
    "info": _Command(
        "services.launcher.inspect_command:info",
        "a key's fields, its row of the topic table, senders and readers",
    ),
    "doctor": _Command(
        "services.launcher.inspect_command:doctor",
        "is all well, and if not, which command mends it",
    ),
    "record": _Command(
        "services.launcher.record:record",
        "what is said on the bus, byte for byte, into a file",
    ),
    "replay": _Command(
        "services.launcher.replay:replay",
        "a recording: the same bytes under the same keys, with pause and seek",
    ),
    "remap": _Command(
        "services.launcher.remap:remap",
        "a recording's clouds into a map with other settings",
    ),
    "export": _Command(
        "services.launcher.export:export",
        "a recording as Foxglove's MCAP, as points, as a film",
    ),
    "certs": _Command(
        "services.launcher.certs:certs",
        "an authority and certificates, for a bus that lets in nobody else",
    ),
    "health": _Command(
        "services.launcher.health:health",
        "whether a service is on the bus; for those who restart what is not",
    ),
    "compile": _Command(
        "services.launcher.compile_command:compile_kernels",
        "the kernels, now and not at the first start; for who builds images",
    ),
}
_SERVICES = {
    "simulator": "the world: a target that moves and deforms, the cameras' bodies",
    "camera": "one depth camera",
    "planner": "where the cameras go next",
    "mapper": "all clouds of an instant into one map",
    "evaluator": "the map against the truth",
    "viewer": "the run in a browser, and its controls",
    "router": "introduces the services to each other",
}
EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED = 1, 2, 130


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
        case [name, *rest] if name in _COMMANDS:
            return _carry_out(name, rest)
        case [service, *rest] if service in _SERVICES:
            return _serve(service, rest)
        case _:
            known = ", ".join((*_COMMANDS, *_SERVICES))
            print(f"encircle: no command {args[0]!r}; known: {known}", file=sys.stderr)
            return EXIT_USAGE


def _help() -> str:
    commands = "\n".join(f"  {name:<10} {each.about}" for name, each in _COMMANDS.items())
    services = "\n".join(f"  {name:<10} {what}" for name, what in _SERVICES.items())
    return f"""\
encircle: many depth cameras, one live 3D model.

{commands}

one service alone, to be joined by others:
{services}

`encircle COMMAND --help` tells its flags; `encircle --version` the version."""


def _carry_out(name: str, args: Sequence[str]) -> int:
    from services.launcher.errors import LauncherError, MissingExtraError, SettingsError

    module, function = _COMMANDS[name].where.split(":")
    try:
        return int(getattr(import_module(module), function)(args))
    except (SettingsError, MissingExtraError) as error:
        print(f"encircle {name}: {error}", file=sys.stderr)
        return EXIT_USAGE
    except LauncherError as error:
        print(f"encircle {name}: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


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
