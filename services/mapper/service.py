"""The mapper on the bus: clouds and the target's pose in; changes, summary, snapshots out."""

import logging
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from schemas.camera import MAX_CAMERAS
from schemas.cloud import Cloud
from schemas.geometry import WORLD
from schemas.map import MapChanges, MapSummary
from schemas.sim import SimClock
from schemas.target import TargetPose
from schemas.topics import CAMERA_CLOUD, MAP_CHANGES, MAP_FULL, MAP_SUMMARY, SIM_CLOCK, TARGET_POSE
from services.mapper.barrier import Barrier, Close, Take
from services.mapper.errors import MapperError
from services.mapper.fusion import Fusion, MemorySettings
from services.mapper.report import Reporter
from services.mapper.settings import MapperSettings
from services.mapper.target_track import TargetTrack
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.loop import Loop, Timer
from services.runtime.reader import Received

logger = logging.getLogger(__name__)


class MapperService:
    """Fuses every instant's clouds in camera order, each as soon as its turn has come."""

    def __init__(self, settings: MapperSettings, bus: Bus, loop: Loop) -> None:
        warm_up()  # Before others wait for us: the first instant must not be late.
        self._settings, self._bus, self._loop = settings, bus, loop
        self._fusion = Fusion(settings.empty_map(), settings.memory_settings())
        self._reporter = Reporter(self._fusion, settings.frame, settings.entropy_every)
        self._barrier: Barrier[Cloud] = Barrier()
        self._track = TargetTrack()
        self._steps: deque[Take[Cloud] | Close] = deque()
        self._tick: int | None = None
        """The instant that is being fused."""
        self._t_ns, self._t_capture_ns = 0, 0
        self._told: tuple[MapChanges, MapSummary] | None = None
        self._lockstep = True
        self._timer: Timer | None = None
        self._timed_tick: int | None = None
        loop.on(CAMERA_CLOUD, self._on_cloud)
        loop.on(TARGET_POSE, self._on_target)
        loop.on(SIM_CLOCK, self._on_clock)
        loop.on_alive("camera", self._on_camera)
        loop.answer(MAP_FULL, self._reporter.full)
        for verb in (self.reset, self.get, self.set, self.save):
            loop.serve(verb.__name__, verb)

    # What arrives.

    def _on_clock(self, received: Received[SimClock]) -> None:
        self._lockstep = received.message.mode == "lockstep"

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
        if cloud.frame_id != WORLD:
            self._bus.refuse(received.key, f"frame_id is {cloud.frame_id!r}; it must be {WORLD!r}")
            return
        if self._track.is_far_from(cloud.tick):
            self._bus.refuse(received.key, f"tick {cloud.tick} is not near the target's newest")
            return
        self._go_on(self._barrier.offer(cloud.tick, cloud.camera, cloud))

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
                self._fusion.fuse(step.cloud)
        except MapperError as error:
            self._bus.refuse(CAMERA_CLOUD.key_for(step.camera), str(error))
        self._t_capture_ns = min(self._t_capture_ns, step.cloud.t_capture_ns)
        return True

    def _begin(self, cloud: Cloud, guess: bool) -> bool:
        T_world_map = np.eye(4)
        if self._settings.frame == "target":
            T_world_target = self._track.at(cloud.tick, cloud.t_ns, guess)
            if T_world_target is None:
                return False
            T_world_map = T_world_target
        self._tick, self._t_ns, self._t_capture_ns = cloud.tick, cloud.t_ns, cloud.t_capture_ns
        self._fusion.begin(cloud.t_ns, T_world_map)
        return True

    def _publish(self, close: Close) -> None:
        with self._loop.stage("publish"):
            changes = self._reporter.changes(close.tick, self._t_ns)
            self._bus.publish(MAP_CHANGES, changes)
            latency_ms = max(time.time_ns() - self._t_capture_ns, 0) * 1e-6
            summary = self._reporter.summary(close, latency_ms, self._barrier.num_late)
            self._bus.publish(MAP_SUMMARY, summary)
            self._told = changes, summary
        if close.missing:
            logger.warning("tick %d: nothing from cameras %s", close.tick, close.missing)
        self._tick = None

    def _watch(self) -> None:
        """Give an instant that is waited for a deadline; once, when it begins."""
        waiting = self._steps[0].tick if self._steps else self._barrier.open_tick
        if waiting == self._timed_tick:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timed_tick, self._timer = waiting, None
        if waiting is not None:
            settings = self._settings
            delay_s = settings.deadline_s if self._lockstep else settings.realtime_deadline_s
            self._timer = self._loop.after(delay_s, self._on_deadline)

    # What is asked: ctl/mapper/<verb>.

    def reset(self, params: dict[str, Any]) -> dict[str, Any]:
        """Forget the map; the next changes tell."""
        only(params)
        self._fusion.voxel_map.clear()
        return self.get({})

    def get(self, params: dict[str, Any]) -> dict[str, Any]:
        """Return what the map is and holds."""
        only(params)
        voxel_map, memory = self._fusion.voxel_map, self._fusion.memory
        return {
            "rev": self._reporter.rev,
            "cameras": list(self._barrier.alive),
            "frame": self._settings.frame,
            "voxel_size": voxel_map.box.resolution_m,
            "origin_m": voxel_map.box.origin_m.tolist(),
            "shape": list(voxel_map.box.shape),
            "entropy_bits": voxel_map.entropy_bits(),
            "num_bytes": voxel_map.num_bytes,
            **memory.model_dump(),
            **voxel_map.counts()._asdict(),
        }

    def set(self, params: dict[str, Any]) -> dict[str, Any]:
        """Change `memory` or `half_life_s`, from the next instant on."""
        only(params, *MemorySettings.model_fields)
        merged = {**self._fusion.memory.model_dump(), **params}
        self._fusion.memory = MemorySettings.model_validate(merged)
        return self.get({})

    def save(self, params: dict[str, Any]) -> dict[str, Any]:
        """Write the map to `path` (.ply or .npz), as it is now."""
        only(params, "path")
        path = Path(str(params["path"])).absolute()
        self._fusion.voxel_map.save(path)
        return {"path": str(path), **self._fusion.voxel_map.counts()._asdict()}
