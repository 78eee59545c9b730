"""The instants of a recording: who saw what at which tick, in the order of ticks and cameras."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from schemas.cloud import Cloud
from schemas.codec import decode
from schemas.geometry import WORLD
from schemas.message import MessageError
from schemas.target import TargetPose
from schemas.topics import CAMERA_CLOUD, TARGET_POSE, find
from services.mapper.target_track import TargetTrack
from services.recorder.log_file import Record

_LATE_TICKS = 8  # Clouds of a tick may still come while so many later ticks have begun.


class Instant(NamedTuple):
    """All clouds of one tick."""

    tick: int
    t_ns: int
    T_world_target: NDArray[np.float64] | None
    """(4, 4); None: no pose of the target was recorded near it."""
    clouds: tuple[Cloud, ...]
    """By camera."""


class Instants:
    """Sorts what was recorded in order of arrival into instants; `num_bad` counts what is none."""

    def __init__(self) -> None:
        self.num_bad = 0
        self._track = TargetTrack()
        self._open: dict[int, dict[int, Cloud]] = {}
        self._newest = -1

    def of(self, records: Iterable[Record]) -> Iterator[Instant]:
        """Yield the instants of records, clouds and poses of the target among them."""
        for record in records:
            topic = find(record.key)
            try:
                message = None if topic is None else decode(topic.adapter, record.payload)[1]
            except MessageError:
                self.num_bad += 1
                continue
            if message is None or message.frame_id != WORLD:
                self.num_bad += 1
            elif topic is TARGET_POSE:
                yield from self._add_target(message)
            elif topic is CAMERA_CLOUD:
                yield from self._add_cloud(message)
        yield from self._close()

    def _add_target(self, pose: TargetPose) -> Iterator[Instant]:
        if pose.tick < self._newest - _LATE_TICKS:  # A new run, which has the ticks again.
            yield from self._close()
        self._track.add(pose)

    def _add_cloud(self, cloud: Cloud) -> Iterator[Instant]:
        if cloud.tick < self._newest - _LATE_TICKS:
            yield from self._close()
        self._newest = max(self._newest, cloud.tick)
        self._open.setdefault(cloud.tick, {})[cloud.camera] = cloud
        while (oldest := min(self._open)) < self._newest - _LATE_TICKS:
            yield self._instant(oldest)

    def _close(self) -> Iterator[Instant]:
        for tick in sorted(self._open):
            yield self._instant(tick)
        self._newest = -1

    def _instant(self, tick: int) -> Instant:
        clouds = tuple(cloud for _, cloud in sorted(self._open.pop(tick).items()))
        t_ns = clouds[0].t_ns
        return Instant(tick, t_ns, self._track.at(tick, t_ns, guess=True), clouds)
