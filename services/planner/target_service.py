"""Where the target will be at the next instant: told, from a tracker, or from the map."""

from typing import assert_never

import numpy as np

from schemas.geometry import WORLD
from schemas.target import TargetObservation, TargetPose
from schemas.topics import TARGET_ESTIMATE, TARGET_OBSERVATION, TARGET_POSE
from services.planner.map_target_service import MapTarget
from services.planner.motion import Motion
from services.planner.settings import PlannerSettings
from services.planner.target_estimate import Aim, estimate_of, fix_of, guess
from services.planner.target_filter import TargetFilter, motion_of
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.reader import Received


def open_target(settings: PlannerSettings, bus: Bus, loop: Loop, aim: Aim) -> object:
    """Call `aim` at every instant; keep what is returned."""
    match settings.target:
        case "given":
            return GivenTarget(settings, bus, loop, aim)
        case "filtered":
            return FilteredTarget(settings, bus, loop, aim)
        case "map":
            return MapTarget(settings, bus, loop, aim)
        case _:
            assert_never(settings.target)


class GivenTarget:
    """Believes `target/pose`."""

    def __init__(self, settings: PlannerSettings, bus: Bus, loop: Loop, aim: Aim) -> None:
        self._dt_s, self._bus, self._aim = settings.dt_s, bus, aim
        loop.on(TARGET_POSE, self._on_pose)

    def _on_pose(self, received: Received[TargetPose]) -> None:
        told = received.message
        if told.frame_id != WORLD:
            self._bus.refuse(received.key, f"frame_id is {told.frame_id!r}; it must be {WORLD!r}")
            return
        linear, angular = np.asarray(told.twist.linear), np.asarray(told.twist.angular)
        self._aim(told, Motion(told.pose.matrix(), linear, angular).predicted(self._dt_s))


class FilteredTarget:
    """Filters `target/observation`, and predicts what the delay and the losses hide."""

    def __init__(self, settings: PlannerSettings, bus: Bus, loop: Loop, aim: Aim) -> None:
        self._settings, self._bus, self._loop, self._aim = settings, bus, loop, aim
        self._dt_ns = round(settings.dt_s * 1e9)
        self._begin_anew()
        loop.on(TARGET_OBSERVATION, self._on_observation)

    def _begin_anew(self) -> None:
        self._filter = TargetFilter(self._settings.target_agility(), self._settings.bridge_s)
        self._tick, self._num_missed = -1, 0

    def _on_observation(self, received: Received[TargetObservation]) -> None:
        told = received.message
        if told.frame_id != WORLD:
            self._bus.refuse(received.key, f"frame_id is {told.frame_id!r}; it must be {WORLD!r}")
            return
        seen_ns = told.t_ns if told.sighting is None else told.sighting.t_ns
        if seen_ns > told.t_ns:
            self._bus.refuse(received.key, f"seen at {seen_ns} ns, told before: at {told.t_ns} ns")
            return
        with self._loop.stage("estimate"):
            self._take(told)
            now, then = (self._filter.at(t) for t in (told.t_ns, told.t_ns + self._dt_ns))
        if now is None or then is None:
            self._aim(told, guess(self._settings))
            return
        counts = self._filter.num_used, self._filter.num_refused, self._num_missed
        self._bus.publish(TARGET_ESTIMATE, estimate_of(told, now, *counts))
        self._aim(told, motion_of(then))

    def _take(self, told: TargetObservation) -> None:
        if told.tick < self._tick:
            self._begin_anew()
        if told.sighting is not None:
            self._filter.add(fix_of(told.sighting))
        elif told.tick != self._tick:
            self._num_missed += 1
        self._tick = told.tick
