"""The mapper on the bus: clouds and the target's pose in; changes, summary, snapshots out."""

import logging
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from schemas.camera import MAX_CAMERAS, CloudHeard
from schemas.cloud import Cloud
from schemas.geometry import WORLD
from schemas.map import MapChanges, MapSummary
from schemas.sim import SimClock, SimMode
from schemas.target import TargetPose
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CLOUD_HEARD,
    MAP_CHANGES,
    MAP_FULL,
    MAP_SUMMARY,
    SIM_CLOCK,
    TARGET_POSE,
)
from services.mapper.barrier import Barrier, Close, Take
from services.mapper.clocks import Clocks
from services.mapper.errors import MapperError
from services.mapper.fusion import Fusion
from services.mapper.patience import Patience
from services.mapper.pictures import Album, NoPictures, Pictures
from services.mapper.report import Reporter
from services.mapper.requests_service import Requests
from services.mapper.settings import MapperSettings
from services.mapper.silence import Silence
from services.mapper.snapshots_service import snapshots_of
from services.mapper.target_track import TargetTrack
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.loop import Loop, Timer
from services.runtime.reader import Received

logger = logging.getLogger(__name__)

_MOST_ASKED = 256  # Requests that wait; beyond, the oldest goes without an answer.


class MapperService:
    """Fuses every instant's clouds in camera order, each as soon as its turn has come."""

    def __init__(self, settings: MapperSettings, bus: Bus, loop: Loop) -> None:
        warm_up()  # Before others wait for us: the first instant must not be late.
        self._settings, self._bus, self._loop = settings, bus, loop
        self._fusion = Fusion(settings.empty_map(), settings.memory_settings())
        self._placement = settings.placement()
        self._reporter = Reporter(self._fusion, settings.frame, settings.entropy_every)
        self._barrier: Barrier[Cloud] = Barrier()
        self._pictures: Album = Pictures() if settings.color else NoPictures()
        self._track = TargetTrack()
        self._silence = Silence()
        self._clocks = Clocks()
        self._steps: deque[Take[Cloud] | Close] = deque()
        self._tick: int | None = None
        """The instant that is being fused."""
        self._t_ns, self._t_capture_ns = 0, 0
        self._asked: deque[Callable[[], None]] = deque(maxlen=_MOST_ASKED)
        """Requests that wait for the end of the instant."""
        self._told: tuple[MapChanges, MapSummary] | None = None
        self._mode: SimMode | None = None
        """Who follows no simulator is in no mode."""
        self._patience = Patience(settings.realtime_deadline_s, settings.realtime_deadline_max_s)
        self._timer: Timer | None = None
        self._timed_tick: int | None = None
        loop.on(CAMERA_CLOUD, self._on_cloud)
        loop.on(TARGET_POSE, self._on_target)
        loop.on(SIM_CLOCK, self._on_clock)
        if settings.color:
            loop.on(CAMERA_COLOR, lambda received: self._pictures.keep(received.message))
        loop.on_alive("camera", self._on_camera)
        loop.answer(MAP_FULL, self._reporter.full)
        snapshots = snapshots_of(settings, self._fusion, self._reporter)
        snapshots.begin(loop, self._between_instants)
        requests = Requests(
            settings, self._fusion, self._reporter, self._barrier, self._pictures, snapshots.forget
        )
        requests.serve(loop, self._between_instants)

    # What arrives.

    def _on_clock(self, received: Received[SimClock]) -> None:
        self._mode = received.message.mode

    def _on_camera(self, instance: str, alive: bool) -> None:
        if not instance.isdecimal() or int(instance) >= MAX_CAMERAS:
            return
        if alive:
            self._barrier.appear(int(instance))
        else:
            self._go_on(self._barrier.vanish(int(instance)))

    def _on_target(self, received: Received[TargetPose]) -> None:
        if received.message.frame_id != WORLD:
            reason = f"frame_id is {received.message.frame_id!r}; it must be {WORLD!r}"
            self._bus.refuse(received.key, reason)
            return
        if self._told is not None and self._told[1].tick == received.message.tick:
            self._bus.publish(MAP_CHANGES, self._told[0])  # Asked again: what we said was lost.
            self._bus.publish(MAP_SUMMARY, self._told[1])
        self._track.add(received.message)
        self._go_on([])

    def _on_cloud(self, received: Received[Cloud]) -> None:
        cloud = received.message
        if self._mode != "lockstep":
            self._acknowledge(cloud)
        if cloud.frame_id != WORLD:
            self._bus.refuse(received.key, f"frame_id is {cloud.frame_id!r}; it must be {WORLD!r}")
            return
        if self._track.is_far_from(cloud.tick):
            self._bus.refuse(received.key, f"tick {cloud.tick} is not near the target's newest")
            return
        stamp_ns = received.envelope.t_pub_ns
        if line := self._clocks.note(cloud.camera, stamp_ns, received.t_recv_ns):
            logger.warning("%s", line)
        self._go_on(self._barrier.offer(cloud.tick, cloud.camera, cloud))

    def _acknowledge(self, cloud: Cloud) -> None:
        self._patience.note(cloud.tick, time.monotonic())
        heard = CloudHeard(
            t_ns=cloud.t_ns, tick=cloud.tick, frame_id=cloud.frame_id, camera=cloud.camera
        )
        self._bus.publish(CLOUD_HEARD, heard, camera=cloud.camera)

    def _on_deadline(self) -> None:
        self._timed_tick = None
        self._go_on(self._barrier.expire(), guess=True)

    # What is done.

    def _go_on(self, steps: list[Take[Cloud] | Close], *, guess: bool = False) -> None:
        self._steps.extend(steps)
        while self._steps and self._take(self._steps[0], guess):
            self._steps.popleft()
        self._watch()

    def _take(self, step: Take[Cloud] | Close, guess: bool) -> bool:
        """Carry a step out; False if it has to wait for the target's pose."""
        if isinstance(step, Close):
            if step.tick == self._tick:
                self._publish(step)
            return True
        if step.tick != self._tick and not self._begin(step.cloud, guess):
            if guess:
                logger.warning("tick %d: no pose of the target ever came; not fused", step.tick)
            return guess
        try:
            with self._loop.stage("fuse"):
                self._fusion.fuse(step.cloud, self._picture_of(step.cloud))
        except MapperError as error:
            self._bus.refuse(CAMERA_CLOUD.key_for(step.camera), str(error))
        if not self._clocks.is_off(step.camera):
            self._t_capture_ns = min(self._t_capture_ns, step.cloud.t_capture_ns)
        return True

    def _picture_of(self, cloud: Cloud) -> NDArray[np.uint8] | None:
        try:
            return self._pictures.of(cloud)
        except MapperError as error:
            self._bus.refuse(CAMERA_COLOR.key_for(cloud.camera), str(error))
            return None

    def _begin(self, cloud: Cloud, guess: bool) -> bool:
        T_world_target = self._track.at(cloud.tick, cloud.t_ns, guess)
        if T_world_target is None:
            if self._placement.needs_target:
                return False
            T_world_target = np.eye(4)
        self._answer()  # An instant that was never closed, as a new run began: it ends here.
        self._tick, self._t_ns, self._t_capture_ns = cloud.tick, cloud.t_ns, time.time_ns()
        T_world_map = self._placement.T_world_map(T_world_target)
        try:
            self._fusion.begin(cloud.t_ns, T_world_map, self._placement.centre_m(T_world_target))
        except MapperError as error:
            self._bus.refuse(TARGET_POSE.key_for(), str(error))
        return True

    def _publish(self, close: Close) -> None:
        with self._loop.stage("publish"):
            changes = self._reporter.changes(close.tick, self._t_ns)
            self._bus.publish(MAP_CHANGES, changes)
            latency_ms = max(time.time_ns() - self._t_capture_ns, 0) * 1e-6
            summary = self._reporter.summary(close, latency_ms, self._barrier.num_late)
            self._bus.publish(MAP_SUMMARY, summary)
            self._told = changes, summary
        for line in self._silence.note(close.tick, close.used, close.missing, time.monotonic()):
            logger.warning("%s", line)
        self._tick = None
        self._answer()

    def _watch(self) -> None:
        """Give an instant that is waited for a deadline; once, when it begins."""
        waiting = self._steps[0].tick if self._steps else self._barrier.open_tick
        if waiting == self._timed_tick:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timed_tick, self._timer = waiting, None
        if waiting is not None:
            waits = self._mode == "realtime"
            delay_s = self._patience.wait_s if waits else self._settings.deadline_s
            self._timer = self._loop.after(delay_s, self._on_deadline)

    def _between_instants(self, call: Callable[[], None]) -> None:
        """Let a request wait until the instant at hand is told."""
        if self._tick is None:
            call()
        else:
            self._asked.append(call)

    def _answer(self) -> None:
        while self._asked:
            self._asked.popleft()()
