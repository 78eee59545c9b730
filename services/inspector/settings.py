"""What the commands that look at the bus can be told."""

from typing import Annotated

import tyro
from pydantic import BaseModel, ConfigDict, Field

from services.runtime.settings import BusSettings

Seconds = Annotated[float, Field(gt=0, le=1e7, allow_inf_nan=False)]
Keys = tyro.conf.Positional[
    Annotated[tuple[str, ...], Field(min_length=1), tyro.conf.arg(metavar="KEY...")]
]
Json = Annotated[bool, tyro.conf.arg(name="json")]


class LookSettings(BaseModel):
    """Base: how to join the bus."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    bus: BusSettings = Field(default_factory=BusSettings)
    """How to join the bus."""


class ListenSettings(LookSettings):
    """Base of the commands that listen until they are stopped."""

    keys: Keys
    """Keys or key expressions, e.g. 'cams/*/pose'; `*` is one part, `**` any number."""
    duration: Seconds | None = None
    """Stop after so many seconds, with exit code 1 if nothing came; else at Ctrl-C."""
    json_: Json = False
    """One JSON object per line."""


class EchoSettings(ListenSettings):
    """Print what is said on a key. A part of it: `formation.radius_m`, or --field."""

    field: str = ""
    """Print this part only, e.g. pose.position or topics[0].rate_hz."""
    once: bool = False
    """Stop after one message."""
    num: Annotated[int | None, Field(gt=0), tyro.conf.arg(aliases=["-n"])] = None
    """Stop after so many messages."""
    rate: Annotated[float | None, Field(ge=0, le=1e6)] = None
    """Of each key at most so many per second, the others are counted; 0: all. By default 10 on a
    terminal, all into a file or pipe."""
    line: bool = False
    """One line per message."""
    full: bool = False
    """Long lists to their end; arrays of clouds and maps are described all the same."""


class RateSettings(ListenSettings):
    """Print once a second how often a key is sent, as its sender numbers and stamps it: what the
    listener misses does not count, and is told."""

    window: Seconds = 5.0
    """Figures are of the last so many seconds."""


class ListSettings(LookSettings):
    """List all keys: those of the topic table and those that are heard."""

    expression: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="KEY")]] = "**"
    """Only these."""
    listen: Seconds = 2.0
    """How long to listen, s."""
    json_: Json = False
    """One JSON object per line."""


class InfoSettings(LookSettings):
    """Tell of a key: its message's fields, its row of the topic table, who sends it, who reads it,
    and what was said last."""

    key: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="KEY")]]
    """A key or key expression, e.g. cams/0/cloud."""
    json_: Json = False
    """One JSON object: the schema is JSON Schema."""


class DoctorSettings(LookSettings):
    """Examine a running system; each failed line comes with the command that mends it, and the exit
    code is 1."""

    listen: Annotated[float, Field(ge=2.5, le=600)] = 3.0
    """How long to listen, s; heartbeats come once a second and two are compared."""
    json_: Json = False
    """One JSON object per line."""
