"""A recording in Foxglove's schemas, as an MCAP file."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Annotated, Any, NamedTuple, get_args

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema
from pydantic import BaseModel, ConfigDict, Field

from schemas.map import MapChanges, MapFull, MapSummary
from schemas.message import Message
from schemas.metrics import Quality
from schemas.sim import SimClock
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_GOAL,
    CAMERA_INFO,
    CAMERA_POSE,
    FORMATION,
    MAP_CHANGES,
    MAP_FULL,
    MAP_SUMMARY,
    QUALITY,
    SIM_CLOCK,
    TARGET_ESTIMATE,
    TARGET_POSE,
)
from services.kernels.palette import VIRIDIS, colours
from services.kernels.rigid import FloatArray, apply
from services.recorder.export.decoded import Decoded
from services.recorder.export.errors import ExportError
from services.recorder.export.foxglove import Convertible, Said, converted
from services.recorder.export.foxglove_points import map_cloud
from services.recorder.export.moment import Moment
from services.recorder.export.reading import Reading
from services.recorder.export.timeline import Timeline
from services.recorder.log_file import RecordedLog
from services.runtime.map_mirror import MapMirror

_CONVERTED = (
    CAMERA_CLOUD, CAMERA_COLOR, CAMERA_GOAL, CAMERA_INFO, CAMERA_POSE, FORMATION, MAP_CHANGES,
    MAP_FULL, MAP_SUMMARY, QUALITY, SIM_CLOCK, TARGET_ESTIMATE, TARGET_POSE,
)  # fmt: skip
_PLAIN = (MapSummary, Quality, SimClock)
"""Numbers to be plotted: as JSON, whose schema is the message's own."""


class FoxgloveSettings(BaseModel):
    """What goes into the file, and how densely."""

    model_config = ConfigDict(frozen=True)

    pixel_step: Annotated[int, Field(ge=0, le=64)] = 4
    """Every so many-th pixel of a depth image, each way, is also a point; 0: none."""
    map_every_s: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """The map goes in at most so often; 0: with every change."""


class Written(NamedTuple):
    """What is in a file."""

    num_messages: int
    recorded_s: float
    """How long what was recorded took, by its own clock."""
    took_s: float
    num_gaps: int
    """Changes of the map that were missing what they build on."""
    num_bad: int
    """Messages that could not be read."""


def write_foxglove(
    log: RecordedLog, path: Path, settings: FoxgloveSettings, progress: Callable[[float], None]
) -> Written:
    """Write a recording in Foxglove's schemas; every message at the time it was measured.

    Args:
        log: the recording.
        path: to be written, beside its place first.
        settings: what goes in.
        progress: is told the share that is done, now and then.

    Raises:
        ExportError: If there is nothing to write, or it cannot be written.
    """
    began_s = time.monotonic()
    reading = Reading(log)
    last_s = reading.ticks()[-1][1]
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            out = _Out(file)
            told = _tell(reading, out, settings, lambda now_s: progress(now_s / max(last_s, 1e-9)))
            out.finish()
        part.replace(path)
    except OSError as error:
        raise ExportError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)
    num_bad = reading.decoder.bad.total()
    return Written(out.num, last_s, time.monotonic() - began_s, told.num_gaps, num_bad)


def _tell(
    reading: Reading, out: "_Out", settings: FoxgloveSettings, progress: Callable[[float], None]
) -> Moment:
    timeline, moment = Timeline(reading.keys), Moment()
    every_ns, next_ns = round(settings.map_every_s * 1e9), -1
    for said in reading.messages(_CONVERTED):
        if said.key == timeline.clock:
            timeline.advance(said.message.t_ns)
            progress(timeline.elapsed_s(said.message.t_ns))
        t_ns = said.message.t_ns + timeline.shift_ns
        match said.message:
            case MapChanges() | MapFull():
                moment.take(said, timeline.elapsed_s(said.message.t_ns))
                if moment.mirror.latest is said.message and t_ns >= next_ns:
                    cloud = _map(moment.mirror, moment.T_world_map, t_ns)
                    out.add(cloud, t_ns, said.publish_ns)
                    next_ns = t_ns + every_ns
            case message if isinstance(message, _PLAIN):
                out.add_plain(said, t_ns)
            case message if isinstance(message, get_args(Convertible)):
                for each in converted(message, t_ns, settings.pixel_step):
                    out.add(each, t_ns, said.publish_ns)
    return moment


def _map(mirror: MapMirror, T_world_map: FloatArray, t_ns: int) -> Said:
    """Return the occupied voxels, coloured by their height above the ground."""
    heights_m = apply(T_world_map, mirror.centres())[:, 2]
    top_m = float(heights_m.max(initial=0.0))
    rgb = np.rint(255 * colours(VIRIDIS, heights_m / max(top_m, 1e-9)))
    rgba = np.concatenate([rgb, np.full((len(rgb), 1), 255)], axis=1).astype(np.uint8)
    return Said("/map/occupied", map_cloud(mirror, rgba, t_ns))


class _Out:
    """The file: channels and schemas as they are met."""

    def __init__(self, file: IO[bytes]) -> None:
        self._writer: Any = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start("", "encircle export")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.num = 0

    def add(self, said: Said, t_ns: int, publish_ns: int) -> None:
        """Append a message of Foxglove's."""
        kind = type(said.message)
        if said.topic not in self._channels:
            name = kind.DESCRIPTOR.full_name
            if name not in self._schemas:
                self._schemas[name] = register_schema(self._writer, kind)
            self._open(said.topic, MessageEncoding.Protobuf, self._schemas[name])
        self._append(said.topic, said.message.SerializeToString(), t_ns, publish_ns)

    def add_plain(self, said: Decoded, t_ns: int) -> None:
        """Append a message of ours, as JSON."""
        topic, message = f"/{said.key}", said.message
        if topic not in self._channels:
            self._open(topic, MessageEncoding.JSON, self._json_schema(message))
        self._append(topic, message.model_dump_json().encode(), t_ns, said.publish_ns)

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()

    def _json_schema(self, message: Message) -> int:
        schema = json.dumps(type(message).model_json_schema()).encode()
        name = f"encircle.{type(message).__name__}"
        return int(self._writer.register_schema(name, SchemaEncoding.JSONSchema, schema))

    def _open(self, topic: str, encoding: str, schema: int) -> None:
        self._channels[topic] = self._writer.register_channel(topic, encoding, schema)

    def _append(self, topic: str, data: bytes, t_ns: int, publish_ns: int) -> None:
        self._writer.add_message(self._channels[topic], t_ns, data, publish_ns)
        self.num += 1
