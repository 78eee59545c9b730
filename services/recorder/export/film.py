"""A film of a recording."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_INFO,
    CAMERA_POSE,
    FORMATION,
    MAP_CHANGES,
    MAP_FULL,
    QUALITY,
    TARGET_POSE,
)
from services.recorder.export.caption import put_insets, write
from services.recorder.export.errors import ExportError
from services.recorder.export.film_file import check_ending, check_room, film_file
from services.recorder.export.framing import framed
from services.recorder.export.picture import Painter, PictureSettings, foot_px
from services.recorder.export.reading import Reading
from services.recorder.export.story import story
from services.recorder.export.theme import THEMES
from services.recorder.log_file import RecordedLog

SHOWN = (
    CAMERA_CLOUD, CAMERA_INFO, CAMERA_POSE, FORMATION, MAP_CHANGES, MAP_FULL, QUALITY, TARGET_POSE
)  # fmt: skip
_MOST_PICTURES = 100_000


class FilmSettings(PictureSettings):
    """What is filmed, and how."""

    fps: Annotated[float, Field(ge=1, le=120)] = 15.0
    """Pictures per second of the film."""
    speed: Annotated[float, Field(gt=0, le=1000)] = 1.0
    """Recorded seconds per second of the film."""
    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Begin so long after the recording's first instant."""
    end_s: Annotated[float, Field(gt=0)] | None = None
    """End before; None: with the recording."""

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> Self:
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end {self.end_s:g} s must be after start {self.start_s:g} s")
        return self


class Filmed(NamedTuple):
    """What was made."""

    num_pictures: int
    film_s: float
    """How long it plays."""
    took_s: float
    num_gaps: int
    """Changes of the map that were missing what they build on."""
    num_bad: int
    """Messages that could not be read."""


def film(
    log: RecordedLog, path: Path, settings: FilmSettings, progress: Callable[[float], None]
) -> Filmed:
    """Film a recording.

    Args:
        log: what is shown.
        path: to be written: .mp4, .gif, .webp, or .png (one picture, of the start).
        settings: how.
        progress: is told the share that is done, now and then.

    Raises:
        ExportError: If there is nothing to film, or the film cannot be written.
    """
    check_ending(path)
    began_s = time.monotonic()
    reading = Reading(log)
    times_s = _times(reading, settings, still=path.suffix == ".png")
    check_room(path, len(times_s), settings.width, settings.height)
    theme, painter, moment = THEMES[settings.theme], None, None
    with film_file(path, settings.fps) as out:
        for number, moment in enumerate(reading.moments(SHOWN, times_s)):
            if painter is None:
                painter = Painter(settings, framed(moment))
            picture = painter.paint(moment, number / len(times_s))
            if settings.insets:
                put_insets(picture, painter.pictures(moment), foot_px(settings), theme)
            if settings.caption:
                write(picture, story(moment), theme)
            out.add(picture)
            progress((number + 1) / len(times_s))
    return Filmed(
        len(times_s),
        len(times_s) / settings.fps,
        time.monotonic() - began_s,
        0 if moment is None else moment.num_gaps,
        reading.decoder.bad.total(),
    )


def _times(reading: Reading, settings: FilmSettings, still: bool) -> list[float]:
    """Return the moments, s since the first instant, that are shown."""
    last_s = reading.ticks()[-1][1]
    if settings.start_s > last_s:
        raise ExportError(
            f"start {settings.start_s:g} s is after the recording's last instant, {last_s:.3f} s"
        )
    if still:
        return [settings.start_s]
    end_s = last_s if settings.end_s is None else min(settings.end_s, last_s)
    step_s = settings.speed / settings.fps
    num = max(1, round((end_s - settings.start_s) / step_s))
    if num > _MOST_PICTURES:
        raise ExportError(
            f"{num} pictures are too many (at most {_MOST_PICTURES}): give start, end or speed"
        )
    times: list[float] = (settings.start_s + np.arange(num) * step_s).tolist()
    return times
