"""All that was known at a moment of a recording."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from schemas.camera import CameraInfo, CameraPose
from schemas.cloud import DepthCloud, XyzCloud
from schemas.formation import Formation
from schemas.map import MapChanges, MapFull
from schemas.metrics import Quality
from schemas.target import TargetPose
from services.kernels.rigid import FloatArray
from services.recorder.export.decoded import Decoded
from services.recorder.export.timeline import Timeline
from services.runtime.map_mirror import MapMirror, Outcome

_TRAIL = 4096
"""Places of the target that are remembered: minutes at 15 Hz."""


@dataclass
class Moment:
    """The newest of everything; kept up to date by `take`."""

    elapsed_s: float = 0.0
    """Since the recording's first instant."""
    tick: int = 0
    T_world_target: FloatArray | None = None
    poses: dict[int, FloatArray] = field(default_factory=dict)
    """T_world_camera by camera."""
    infos: dict[int, CameraInfo] = field(default_factory=dict)
    clouds: dict[int, DepthCloud | XyzCloud] = field(default_factory=dict)
    formation: Formation | None = None
    quality: Quality | None = None
    mirror: MapMirror = field(default_factory=MapMirror)
    trail: deque[tuple[float, FloatArray]] = field(default_factory=lambda: deque(maxlen=_TRAIL))
    """When (elapsed, s) the target was where (3,), world."""
    num_gaps: int = 0
    """Changes of the map that could not be taken in: what they build on was not recorded."""
    _mapper: str = ""

    def take(self, said: Decoded, elapsed_s: float) -> None:
        """Take in a message of a moment."""
        message = said.message
        match message:
            case TargetPose():
                self.T_world_target = message.pose.matrix()
                self.trail.append((elapsed_s, self.T_world_target[:3, 3]))
            case CameraPose():
                self.poses[message.camera] = message.pose.matrix()
            case CameraInfo():
                self.infos[message.camera] = message
            case DepthCloud() | XyzCloud():
                self.clouds[message.camera] = message
                self.poses[message.camera] = message.pose.matrix()
            case Formation():
                self.formation = message
            case Quality():
                self.quality = message
            case MapChanges() | MapFull():
                self._map(message, said.boot)

    def _map(self, message: MapChanges | MapFull, boot: str) -> None:
        if boot != self._mapper:
            self._mapper = boot
            self.mirror.forget()
        if isinstance(message, MapFull):
            self.mirror.reset(message)
        elif self.mirror.apply(message) is Outcome.GAP:
            self.num_gaps += 1

    @property
    def T_world_map(self) -> FloatArray:
        """(4, 4) of the map that is held; the identity where none is."""
        latest = self.mirror.latest
        return np.eye(4) if latest is None else latest.pose.matrix()

    def clouds_of_the_instant(self) -> list[DepthCloud | XyzCloud]:
        """Return the newest clouds that were seen at one and the same instant, by camera."""
        newest = max((cloud.tick for cloud in self.clouds.values()), default=0)
        return [self.clouds[i] for i in sorted(self.clouds) if self.clouds[i].tick == newest]


def moments(
    messages: Iterable[Decoded], timeline: Timeline, times_s: Iterable[float]
) -> Iterator[Moment]:
    """Yield what was known at each time, in order; the same object, brought up to date.

    An instant is over, and all of it known, when the clock tells of the next. The first time that
    is beyond the recording's end has what was known there, if nothing earlier had.

    Args:
        messages: of one recording, from its beginning: a map is the sum of its changes.
        timeline: fresh, of that recording.
        times_s: ascending, since its first instant.
    """
    moment, times = Moment(), iter(times_s)
    wanted_s = next(times, None)
    num_yielded = 0
    for said in messages:
        if said.key == timeline.clock:
            timeline.advance(said.message.t_ns)
            now_s = timeline.elapsed_s(said.message.t_ns)
            while wanted_s is not None and wanted_s < now_s:
                yield moment
                num_yielded += 1
                wanted_s = next(times, None)
            if wanted_s is None:
                return
            moment.elapsed_s, moment.tick = now_s, said.message.tick
        moment.take(said, timeline.elapsed_s(said.message.t_ns))
    while wanted_s is not None and (wanted_s <= moment.elapsed_s or not num_yielded):
        yield moment
        num_yielded += 1
        wanted_s = next(times, None)
