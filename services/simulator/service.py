"""The simulator on the bus: it owns time and the truth."""

import logging
import time
from collections.abc import Callable
from typing import Any

from schemas.camera import CameraCommand, CameraGoal
from schemas.topics import (
    CAMERA_COMMAND,
    CAMERA_GOAL,
    MAP_SUMMARY,
    QUALITY,
    SIM_CLOCK,
    SIM_STATE,
    TARGET_POSE,
)
from services.kernels.rigid import FloatArray
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.errors import BadCommand
from services.runtime.loop import Loop, Timer
from services.runtime.reader import Received
from services.simulator.bodies import Bodies
from services.simulator.clock import Clock
from services.simulator.commands import Commands
from services.simulator.messages import sim_clock, sim_state, target_pose
from services.simulator.pace import Pace
from services.simulator.proximity import Proximity
from services.simulator.settings import SimulatorSettings
from services.simulator.world_state import Limits, World
from services.world.scene import Scene

logger = logging.getLogger(__name__)

ANNOUNCE_PERIOD_S = 0.2  # How often the clock is told while it stands.
_SERVICES = ("camera", "planner", "mapper", "evaluator", "launcher")


class Simulator:
    """Publishes the world at each tick and goes on when all have acknowledged, or on time."""

    def __init__(self, settings: SimulatorSettings, bus: Bus, loop: Loop) -> None:
        self._settings, self._bus, self._loop = settings, bus, loop
        self._spec = settings.scene()
        limits = Limits(settings.max_speed_m_s, settings.max_turn_rad_s)
        self._world = World(settings.motion(), settings.dt_ns, limits)
        self._bodies = Bodies(Scene.from_spec(self._spec).rest.vertices_m, settings.cameras)
        self._proximity = Proximity()
        cameras = (f"camera/{i}" for i in range(settings.cameras))
        expected = {*settings.wait_for, *cameras}
        self._clock = Clock(settings.mode == "lockstep", expected, settings.num_ticks)
        self._commands = Commands()
        self._pace = Pace(settings.dt_s)
        self._tick_began_s = 0.0
        self._timer: Timer | None = None
        loop.on(CAMERA_GOAL, self._on_goal)
        loop.on(CAMERA_COMMAND, self._on_command)
        loop.on(MAP_SUMMARY, lambda got: self._acknowledge("mapper", got.message.tick))
        loop.on(QUALITY, lambda got: self._acknowledge("evaluator", got.message.tick))
        for service in _SERVICES:
            loop.on_alive(service, self._presence_of(service))
        for verb in (self.pause, self.resume, self.step, self.reset, self.get):
            loop.serve(verb.__name__, verb)
        loop.every(ANNOUNCE_PERIOD_S, self._announce)

    # What arrives: goals, commands, acknowledgements, who is there.

    def _on_goal(self, received: Received[CameraGoal]) -> None:
        goal = received.message
        # At tick 0 alone: what is under way from before a reset must place nobody.
        expected = goal.tick == 0 and goal.camera < self._settings.cameras
        if expected and self._clock.state == "waiting":
            self._world.spawn(goal.camera, goal.pose.matrix())
            self._start_if_complete()
        self._acknowledge("planner", goal.tick)

    def _on_command(self, received: Received[CameraCommand]) -> None:
        command = received.message
        if command.camera < self._settings.cameras:
            self._commands.put(command)
            self._acknowledge(f"camera/{command.camera}", command.tick)

    def _presence_of(self, service: str) -> Callable[[str, bool], None]:
        def on_alive(instance: str, up: bool) -> None:
            name = f"{service}/{instance}" if service == "camera" else service
            if up:
                self._clock.appear(name)
                self._start_if_complete()
            else:
                self._clock.vanish(name)
                self._go_on()

        return on_alive

    def _acknowledge(self, name: str, tick: int) -> None:
        self._clock.acknowledge(name, tick)
        self._go_on()

    # Time passes.

    def _start_if_complete(self) -> None:
        if self._clock.start(self._placed()):
            logger.info("all there; tick 0")
            self._pace.begin(time.monotonic())
            self._begin_tick()

    def _begin_tick(self) -> None:
        self._tick_began_s = time.monotonic()
        with self._loop.stage("publish"):  # First what the others wait for.
            self._publish_world()
            self._publish_clock(())
        with self._loop.stage("proximity"):
            self._check_proximity()
        self._set_timer()

    def _go_on(self) -> None:
        if self._clock.may_end_tick():
            self._end_tick()

    def _end_tick(self) -> None:
        commands = self._valid_commands()
        if self._clock.end_tick():
            self._world.advance(commands)
            self._begin_tick()
        else:
            self._stop_timer()
            logger.info("finished: %d ticks", self._world.tick + 1)
            self._publish_clock(())

    def _on_timeout(self) -> None:
        if late := self._clock.drop_missing():
            logger.warning("tick %d: nothing from %s in time", self._world.tick, ", ".join(late))
        self._set_timer()
        self._go_on()

    def _set_timer(self) -> None:
        self._stop_timer()
        if self._clock.lockstep:
            patience_s = self._settings.patience_s(self._world.tick)
            self._timer = self._loop.after(patience_s, self._on_timeout)
        elif self._clock.state == "running":
            self._timer = self._loop.after(self._pace.wait_s(time.monotonic()), self._end_tick)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _valid_commands(self) -> dict[int, FloatArray]:
        if self._clock.lockstep:
            return self._commands.of_tick(self._world.tick)
        return self._commands.not_older_than(self._settings.command_timeout_s)

    def _placed(self) -> set[str]:
        return {f"camera/{i}" for i in self._world.cameras}

    def _check_proximity(self) -> None:
        poses = {i: body.T_world_camera for i, body in self._world.cameras.items()}
        self._bodies.place(self._world.target().pose(), poses)
        found = self._bodies.encounters(list(poses), self._settings.clearance_m)
        for contact in self._proximity.update(found):
            logger.warning("tick %d: %s hits %s", self._world.tick, contact.one, contact.other)

    # What is told.

    def _announce(self) -> None:
        stalled = time.monotonic() - self._tick_began_s > ANNOUNCE_PERIOD_S
        waiting_for = self._clock.waiting_for(self._placed())
        match self._clock.state:
            case "waiting":
                self._bus.publish(TARGET_POSE, target_pose(self._world))
            case "running" | "paused" if stalled and waiting_for:
                # Told twice, it is answered twice: a lost answer comes, a lost camera comes back.
                self._publish_world()
        if stalled:
            self._publish_clock(waiting_for)

    def _publish_clock(self, waiting_for: tuple[str, ...]) -> None:
        clock = sim_clock(self._world, self._clock, waiting_for, self._pace.overruns)
        self._bus.publish(SIM_CLOCK, clock)

    def _publish_world(self) -> None:
        self._bus.publish(SIM_STATE, sim_state(self._world, self._clock, self._spec))
        self._bus.publish(TARGET_POSE, target_pose(self._world))

    # What is asked: ctl/simulator/<verb>.

    def pause(self, params: dict[str, Any]) -> dict[str, Any]:
        """Hold the clock after the tick at hand."""
        only(params)
        self._clock.pause()
        if not self._clock.lockstep:
            self._stop_timer()
        return self.get({})

    def resume(self, params: dict[str, Any]) -> dict[str, Any]:
        """Let the clock run."""
        only(params)
        was_paused = self._clock.state == "paused"
        self._clock.resume()
        if was_paused:
            self._pace.begin(time.monotonic())
            self._set_timer()
            self._go_on()
        return self.get({})

    def step(self, params: dict[str, Any]) -> dict[str, Any]:
        """Run `ticks` ticks (1 if not given) and hold again."""
        only(params, "ticks")
        ticks = params.get("ticks", 1)
        if not isinstance(ticks, int) or not 1 <= ticks <= 1_000_000:
            raise BadCommand(f"ticks must be a whole number from 1 to 1000000, got {ticks!r}")
        if self._clock.state != "paused":
            raise BadCommand(f"the clock is {self._clock.state}; step needs it paused")
        if self._clock.lockstep:
            self._clock.step(ticks)
            self._go_on()
        else:
            while ticks > 0 and self._clock.state == "paused":
                ticks -= 1
                self._end_tick()
        return self.get({})

    def reset(self, params: dict[str, Any]) -> dict[str, Any]:
        """Go back to tick 0; cameras are placed anew by their next goals."""
        only(params)
        self._stop_timer()
        self._world.reset()
        self._clock.reset()
        self._commands = Commands()
        self._proximity = Proximity()
        self._pace = Pace(self._settings.dt_s)
        return self.get({})

    def get(self, params: dict[str, Any]) -> dict[str, Any]:
        """Tell the clock and what has been counted."""
        only(params)
        return {
            "state": self._clock.state,
            "tick": self._world.tick,
            "t_ns": self._world.t_ns,
            "cameras": sorted(self._world.cameras),
            "waiting_for": list(self._clock.waiting_for(self._placed())),
            "dropped": list(self._clock.dropped),
            "overruns": self._pace.overruns,
            "clipped_commands": self._world.num_clipped,
            "contacts": self._proximity.num_contacts,
            "too_close": self._proximity.num_close,
        }
