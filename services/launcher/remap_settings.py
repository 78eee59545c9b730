"""What `encircle remap` can be told: the mapper's own settings, by default the recording's."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field, ValidationError, field_validator

from services.launcher.processes import mapper_argv
from services.launcher.settings import RunSettings
from services.mapper.errors import MapperError
from services.mapper.formats import check_written
from services.mapper.settings import MapperSettings
from services.recorder.log_file import RecordedLog


class RemapSettings(MapperSettings):
    """Fuse the clouds of a recording anew, with other settings of the mapper.

    What is not given is as it was in the recorded run, if `encircle run` has recorded it.
    """

    file: tyro.conf.Positional[Path | None] = None
    """A recording; it comes first."""
    out: Path | None = None
    """Where to write the last map (.npz .ply .bt .ot .obj .glb)."""
    start: Annotated[float, Field(ge=0)] = 0.0
    """Where to begin, seconds from the recording's beginning."""
    duration: Annotated[float, Field(gt=0)] | None = None
    """How much to fuse, recorded seconds; all if not given."""
    score: bool = False
    """Score every instant against the recorded truth (`sim/state`), as the evaluator does."""
    json_: Annotated[Path | None, tyro.conf.arg(name="json")] = None
    """Also write the figures here."""

    @field_validator("out")
    @classmethod
    def _out_is_a_format(cls, out: Path | None) -> Path | None:
        if out is not None:
            try:
                check_written(out)
            except MapperError as error:
                raise ValueError(str(error)) from None
        return out


def recorded_argv(log: RecordedLog) -> tuple[Sequence[str], str]:
    """Return the flags of the recorded run's mapper, and a word on where they come from."""
    about = log.metadata.get("settings", {}).get("run", "")
    if not about:
        return (), "the mapper's defaults: the recording does not know its run's settings"
    try:
        return mapper_argv(RunSettings.model_validate_json(about)), "the recorded run's settings"
    except ValidationError:
        return (), "the mapper's defaults: the run's settings are of another version"
