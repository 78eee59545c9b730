"""The target found in the map: map/changes in, no pose of the target at all."""

import math

from schemas.geometry import WORLD
from schemas.map import MapChanges
from schemas.sim import SimClock
from schemas.topics import MAP_CHANGES, SIM_CLOCK, TARGET_ESTIMATE
from services.kernels.rigid import apply
from services.planner.settings import PlannerSettings
from services.planner.target_estimate import Aim, estimate_of, guess
from services.planner.target_filter import motion_of
from services.planner.target_from_map import Sight, TargetFromMap
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.map_follower import MapFollower
from services.runtime.reader import Received


class MapTarget:
    """Answers every instant that the mapper has fused.

    Before there is a map nobody knows of an instant: while the simulator waits for the cameras to
    be placed, they are sent to look at the first guess.
    """

    def __init__(self, settings: PlannerSettings, bus: Bus, loop: Loop, aim: Aim) -> None:
        self._settings, self._bus, self._loop, self._aim = settings, bus, loop, aim
        self._dt_ns = round(settings.dt_s * 1e9)
        self._map = MapFollower(bus)
        self._begin_anew()
        loop.on(SIM_CLOCK, self._on_clock)
        loop.on(MAP_CHANGES, self._on_changes)

    def _begin_anew(self) -> None:
        settings = self._settings
        self._target = TargetFromMap(
            settings.target_agility(),
            settings.bridge_s,
            Sight(settings.ground_m, settings.reach_m, settings.map_sigma_m),
            math.radians(settings.guess_deg),
        )
        self._tick = -1

    def _on_clock(self, received: Received[SimClock]) -> None:
        if received.message.state == "waiting":
            self._begin_anew()
            self._aim(received.message, guess(self._settings))

    def _on_changes(self, received: Received[MapChanges]) -> None:
        told = received.message
        if told.frame_id != WORLD:
            self._bus.refuse(
                received.key,
                f"the map's frame is {told.frame_id!r}; target map needs a mapper with frame world",
            )
            return
        with self._loop.stage("estimate"):
            held = self._map.take(received)
            if held is None:
                return
            if held.tick < self._tick:
                self._begin_anew()
            if held.tick != self._tick:  # Told twice, it is answered twice and looked at once.
                points_m = apply(held.pose.matrix(), self._map.mirror.centres())
                self._target.see(held.t_ns, points_m)
            self._tick = held.tick
            now, then = (self._target.at(t) for t in (held.t_ns, held.t_ns + self._dt_ns))
        if now is None or then is None:
            self._aim(held, guess(self._settings))
            return
        counts = self._target.num_used, self._target.num_refused, self._target.num_missed
        self._bus.publish(TARGET_ESTIMATE, estimate_of(held, now, *counts))
        self._aim(held, motion_of(then))
