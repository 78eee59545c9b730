"""The simulator on the bus: it owns time and the truth."""

import logging
import time
from collections.abc import Callable
from typing import Any

from schemas.camera import CameraCommand, CameraGoal
from schemas.topics import CAMERA_COMMAND, CAMERA_GOAL, MAP_SUMMARY, QUALITY
from services.kernels.rigid import FloatArray
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.errors import BadCommand
from services.runtime.later import Later
from services.runtime.loop import Loop, Timer
from services.runtime.reader import Received
from services.simulator.changes_service import Changes, Prepared
from services.simulator.clock import Clock
from services.simulator.commands import Commands
from services.simulator.figures import figures
from services.simulator.pace import Pace
from services.simulator.settings import SimulatorSettings
from services.simulator.teller_service import Teller
from services.simulator.traffic import Traffic
from services.simulator.world_state import World

logger = logging.getLogger(__name__)

ANNOUNCE_PERIOD_S = 0.2  # How often the clock is told while it stands.
_SERVICES = ("camera", "planner", "mapper", "evaluator", "launcher")


class Simulator:
    """Publishes the world at each tick and goes on when all have acknowledged, or on time."""

    def __init__(self, settings: SimulatorSettings, bus: Bus, loop: Loop) -> None:
        self._settings, self._loop = settings, loop
        self._changes = Changes(settings, bus)
        self._world = World(settings.motion(), settings.dt_ns, settings.actuator())
        self._traffic = Traffic(self._changes.now.corners_m, settings.clearance_m)
        self._teller = Teller(bus, settings.tracker())
        expected = self._changes.expected()
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
        loop.serve_later("set", self.change)
        loop.every(ANNOUNCE_PERIOD_S, self._announce)

    # What arrives: goals, commands, acknowledgements, who is there.

    def _on_goal(self, received: Received[CameraGoal]) -> None:
        goal = received.message
        is_new = goal.camera not in self._world.cameras and goal.camera < self._changes.num_cameras
        if is_new and self._clock.admits(f"camera/{goal.camera}", goal.tick):
            yaw_rad = None if goal.robot is None else goal.robot.camera_yaw_rad
            self._world.spawn(goal.camera, goal.pose.matrix(), yaw_rad)
            self._start_if_complete()
        self._acknowledge("planner", goal.tick)

    def _on_command(self, received: Received[CameraCommand]) -> None:
        command = received.message
        if command.camera < self._changes.num_cameras:
            self._commands.put(command)
            self._world.mount(command.camera, command.camera_yaw_rad)
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
        if self._clock.start(self._world.placed()):
            logger.info("all there; tick 0")
            self._pace.begin(time.monotonic())
            self._begin_tick()

    def _begin_tick(self) -> None:
        self._tick_began_s = time.monotonic()
        with self._loop.stage("publish"):  # First what the others wait for.
            self._publish_world()
            self._publish_clock(())
        with self._loop.stage("proximity"):
            contacts = self._traffic.check(self._world)
        for contact in contacts:
            logger.warning("tick %d: %s hits %s", self._world.tick, contact.one, contact.other)
        self._set_timer()

    def _go_on(self) -> None:
        if self._clock.may_end_tick():
            self._end_tick()

    def _end_tick(self) -> None:
        commands = self._valid_commands()
        if self._clock.end_tick():
            self._world.advance(commands)
            self._change()
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

    def _change(self) -> None:
        """Put what was asked into force."""
        if not self._changes.take():
            return
        self._traffic.change_target(self._changes.now.corners_m)
        self._clock.expect(self._changes.expected())
        for camera in [i for i in self._world.cameras if i >= self._changes.num_cameras]:
            self._world.remove(camera)
        logger.info("tick %d: %s", self._world.tick, self._changes.now.wanted)

    # What is told.

    def _announce(self) -> None:
        stalled = time.monotonic() - self._tick_began_s > ANNOUNCE_PERIOD_S
        waiting_for = self._clock.waiting_for(self._world.placed())
        match self._clock.state:
            case "waiting":
                self._teller.tell_target(self._world)
            case "running" | "paused" if stalled and waiting_for:
                # Told twice, it is answered twice: a lost answer comes, a lost camera comes back.
                self._publish_world()
        if stalled:
            self._publish_clock(waiting_for)

    def _publish_clock(self, waiting_for: tuple[str, ...]) -> None:
        self._teller.tell_clock(self._world, self._clock, self._pace.overruns, waiting_for)

    def _publish_world(self) -> None:
        self._teller.tell_world(self._world, self._clock, self._changes.now.spec)

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
        self._traffic.reset()
        self._change()
        self._pace = Pace(self._settings.dt_s)
        return self.get({})

    def get(self, params: dict[str, Any]) -> dict[str, Any]:
        """Tell the clock and what has been counted."""
        only(params)
        world, clock, wanted = self._world, self._clock, self._changes.wanted
        return figures(world, clock, self._traffic, wanted, self._pace.overruns)

    def change(self, params: dict[str, Any]) -> Later[Prepared]:
        """Take on another object, deformation or number of cameras from the next tick on."""
        return Later(self._changes.begin(params, self._clock.present), self._adopt)

    def _adopt(self, prepared: Prepared) -> dict[str, Any]:
        self._changes.adopt(prepared)
        if self._clock.state == "waiting":
            self._change()
            self._start_if_complete()
        elif self._clock.lacks_cameras():  # No tick would end: they may be back with this one.
            self._change()
            self._publish_world()
        return self.get({})
