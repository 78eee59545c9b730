"""Settings from several sources, each overriding the one before, each answerable for its values."""

import difflib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from services.launcher.errors import SettingsError
from services.launcher.settings import ENV_PREFIX, RunSettings


@dataclass(frozen=True)
class Layer:
    """Values and where they come from."""

    source: str
    values: Mapping[str, Any]


def scenario_layer(path: Path) -> Layer:
    """Read a scenario file.

    Raises:
        SettingsError: If it cannot be read, is no TOML, or has a key that we do not know.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # Also of numbers and nests without end.
        raise SettingsError(f"{path}: not TOML: {error}") from error
    known = [name for name in RunSettings.model_fields if name != "scenario"]
    for key in values:
        if key not in known:
            raise SettingsError(f"{path}: unknown key {key!r}; {_hint(key, known)}")
    return Layer(str(path), values)


def environment_layer(environment: Mapping[str, str]) -> Layer:
    """Pick our variables from an environment.

    Raises:
        SettingsError: If one bears our prefix and a name that we do not know.
    """
    known = list(RunSettings.model_fields)
    values = {}
    for variable, value in environment.items():
        if variable.startswith(ENV_PREFIX):
            key = variable.removeprefix(ENV_PREFIX).lower()
            if key not in known:
                raise SettingsError(f"{variable}: unknown; {_hint(key, known)}")
            values[key] = value
    return Layer("environment", values)


def settle(layers: Sequence[Layer]) -> RunSettings:
    """Merge layers, later ones win.

    Raises:
        SettingsError: If a value breaks its rule; the text names the layer it came from.
    """
    merged: dict[str, Any] = {}
    origin: dict[str, str] = {}
    for layer in layers:
        merged |= layer.values
        origin |= dict.fromkeys(layer.values, layer.source)
    try:
        return RunSettings.model_validate(merged)
    except ValidationError as error:
        lines = [_explain(each, origin) for each in error.errors()]
        raise SettingsError("\n".join(lines)) from error


def _explain(error: ErrorDetails, origin: Mapping[str, str]) -> str:
    rule = error["msg"].removeprefix("Value error, ")
    if not error["loc"]:
        return f"{', '.join(sorted(set(origin.values())))}: {rule}"
    key = str(error["loc"][0])
    return f"{origin.get(key, 'default')}: {key} = {error['input']!r}: {rule}"


def _hint(key: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(key.replace("-", "_"), known, n=1)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"{meant}known: {', '.join(known)}"
