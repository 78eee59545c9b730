"""The flags of `encircle run`, on top of scenario and environment."""

import argparse
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypedDict

import tyro

from services.launcher.layers import Layer, environment_layer, scenario_layer, settle
from services.launcher.settings import RUNS_OWN, RunSettings


def parse_run(args: Sequence[str], environment: Mapping[str, str]) -> RunSettings:
    """Read the settings of a run.

    Raises:
        SettingsError: If a value breaks its rule; the text names where it came from.
        SystemExit: If a flag is unknown or help was asked for.
    """
    variables = environment_layer(environment)
    scenario = _scenario(args) or variables.values.get("scenario")
    layers = [scenario_layer(Path(scenario)), variables] if scenario else [variables]
    defaults = settle(layers).model_dump()
    values = tyro.cli(
        _flags(),
        prog="encircle run",
        description=RunSettings.__doc__,
        default=defaults,
        args=_named(args),
    )
    given = {name: value for name, value in values.items() if value != defaults[name]}
    return settle([*layers, Layer("flag", given)])


def _flags() -> Any:
    """Return the fields of the settings as a typed dictionary.

    tyro reads the types from it and leaves the rules to `settle`, which names the source of a
    wrong value whatever that source is.
    """
    fields = RunSettings.model_fields.items()
    flags = {
        name: Annotated[field.annotation, tyro.conf.arg(help=field.description)]
        for name, field in fields
    }
    return TypedDict("Flags", flags)  # type: ignore[operator]


def _named(args: Sequence[str]) -> list[str]:
    """Return the arguments with a name after every `--record` that has none."""
    named: list[str] = []
    for arg, following in itertools.pairwise([*args, "--"]):
        named.append(arg)
        if arg == "--record" and following.startswith("-"):
            named.append(str(RUNS_OWN))
    return named


def _scenario(args: Sequence[str]) -> str | None:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("--scenario")
    try:
        path: str | None = parser.parse_known_args(args)[0].scenario
    except argparse.ArgumentError:
        return None  # tyro will say what is wrong with it.
    return path
