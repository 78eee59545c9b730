"""Settings of recorder and replay."""

import time
from itertools import count
from pathlib import Path
from typing import Annotated, Self

import tyro
from pydantic import Field, field_validator, model_validator

from schemas.topics import TOPICS, Delivery
from services.runtime.key_filter import parse
from services.runtime.settings import BusSettings, ServiceSettings

Keys = tuple[str, ...]


def all_keys() -> Keys:
    """Return the expressions of all that is published by the topic table."""
    return tuple(topic.expression() for topic in TOPICS if topic.delivery is not Delivery.QUERY)


class _OfKeys(ServiceSettings):
    @field_validator("keys", check_fields=False)
    @classmethod
    def _keys_are_expressions(cls, keys: Keys) -> Keys:
        for key in keys:
            parse(key)
        return keys


class RecorderSettings(_OfKeys):
    """Record what is said on the bus, byte for byte, into an MCAP file."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_RECORDER_"}

    file: tyro.conf.Positional[Path | None] = None
    """File to write; recording-<time>.mcap if not given."""
    keys: tyro.conf.Positional[Keys] = ()
    """Key expressions, e.g. 'cams/*/cloud'; all of the topic table if not given."""
    overwrite: bool = False
    """Take the place of a file that is there."""
    numbered: bool = False
    """If the file is there, take the next of name-2.mcap, name-3.mcap ..."""
    snapshot_every_s: Annotated[float, Field(gt=0, le=3600)] = 5.0
    """How often the whole map is asked for and recorded, so that a replay may begin anywhere."""
    queue_mib: Annotated[int, Field(ge=1, le=65536)] = 256
    """What may wait for the disk, MiB; beyond, the oldest samples are dropped and counted."""
    about: str = ""
    """Goes into the file as it is; `encircle run` puts its settings here."""

    def path(self) -> Path:
        """Return where to write."""
        path = self.file or Path(time.strftime("recording-%Y%m%d-%H%M%S.mcap"))
        if not self.numbered or not path.exists():
            return path
        names = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
        return next(name for name in names if not name.exists())

    def expressions(self) -> Keys:
        """Return what to listen to."""
        return self.keys or all_keys()


class ReplaySettings(_OfKeys):
    """Say again what was recorded: the same bytes under the same keys, at the same pace."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_REPLAY_"}

    file: tyro.conf.Positional[Path | None] = None
    """A recording."""
    keys: Keys = ()
    """Key expressions of what to replay; all if not given."""
    rate: Annotated[float, Field(gt=0, le=1000)] = 1.0
    """How many times faster than it was recorded."""
    start: Annotated[float, Field(ge=0)] = 0.0
    """Where to begin, seconds from the recording's beginning."""
    loop: bool = False
    """Begin anew at the end."""
    hold: bool = False
    """Stay at the end, so that one may seek back."""
    paused: bool = False
    """Wait for `ctl/replay/resume`."""
    prefix: str = ""
    """Replay into this namespace, beside a live system; `--bus.namespace` of who is to see it."""
    delay_s: Annotated[float, Field(ge=0, le=60)] = 1.0
    """Before the first sample: who listens is found, and who says the same live."""
    force: bool = False
    """Replay even over live senders of the same keys."""

    @model_validator(mode="after")
    def _ends_one_way(self) -> Self:
        if self.loop and self.hold:
            raise ValueError("loop and hold exclude each other: a loop has no end to stay at")
        return self

    @field_validator("prefix")
    @classmethod
    def _prefix_is_a_key(cls, prefix: str) -> str:
        if prefix and "*" in str(parse(prefix)):
            raise ValueError(f"prefix {prefix!r} must be a plain key, without `*`")
        return prefix

    def joining(self) -> BusSettings:
        """Return how to join the bus: in the prefix's namespace, if there is one."""
        namespace = "/".join(part for part in (self.bus.namespace, self.prefix) if part)
        return self.bus.model_copy(update={"namespace": namespace})
