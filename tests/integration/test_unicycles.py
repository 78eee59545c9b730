"""Planner, simulator and six pilots on a real bus: wheels around a target; nobody renders."""

import math
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import pytest

from schemas.camera import CameraCommand, CameraGoal
from schemas.map import MapSummary
from schemas.sim import SimState
from schemas.topics import (
    CAMERA_COMMAND,
    CAMERA_GOAL,
    MAP_SUMMARY,
    SIM_CLOCK,
    SIM_STATE,
)
from services.camera.unicycle import UnicyclePilot, UnicycleSettings
from services.kernels.rigid import apply, inverse
from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.simulator.service import Simulator
from services.simulator.settings import SimulatorSettings
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]
NUM, TICKS, DT_S = 6, 60, 1 / 15
ROOM_RAD = math.radians(40 - 2) - math.asin(0.2 / 0.8)
"""The whole target is in view, with margin."""
WAIT_S = 30.0


class PilotedCamera:
    """A camera that drives as the service does, and sees nothing."""

    def __init__(self, bus: Bus, loop: Loop, camera: int) -> None:
        self._bus, self._camera = bus, camera
        self._pilot = UnicyclePilot(UnicycleSettings())
        self._state: SimState | None = None
        self._goal: CameraGoal | None = None
        loop.on(SIM_STATE, self._on_state)
        loop.on(CAMERA_GOAL, self._on_goal, camera)

    def _on_state(self, received) -> None:
        self._state = received.message
        self._drive()

    def _on_goal(self, received) -> None:
        self._goal = received.message
        self._drive()

    def _drive(self) -> None:
        state, goal = self._state, self._goal
        if state is None or goal is None or goal.tick != state.tick or not state.cameras:
            return
        body = state.cameras[self._camera]
        twist = self._pilot.command(body, state.tick, goal, DT_S)
        command = CameraCommand(
            t_ns=state.t_ns, tick=state.tick, frame_id="world", camera=self._camera, twist=twist
        )
        self._bus.publish(CAMERA_COMMAND, command, camera=self._camera)


class Mapper:
    """Acknowledges every instant and keeps the states."""

    def __init__(self, bus: Bus, loop: Loop) -> None:
        self._bus = bus
        self.states: dict[int, SimState] = {}
        loop.on(SIM_STATE, self._on_state)

    def _on_state(self, received) -> None:
        state = received.message
        self.states[state.tick] = state
        summary = MapSummary(
            t_ns=state.t_ns,
            tick=state.tick,
            frame_id="target",
            rev=state.tick,
            cameras_used=(),
            cameras_missing=(),
            num_returns=0,
            num_occupied=0,
            num_free=0,
            num_changed=0,
            fuse_ms=0.0,
            latency_ms=0.0,
            memory="instant",
        )
        self._bus.publish(MAP_SUMMARY, summary)


def bearings(state: SimState) -> np.ndarray:
    centre = apply(state.target.matrix(), [0.0, 0.0, 0.2])
    seen = [apply(inverse(body.pose.matrix()), centre) for body in state.cameras]
    return np.array([math.atan2(x, z) for x, _, z in seen])


def test_six_unicycles_enclose_a_target_over_the_bus(open_bus: OpenBus) -> None:
    with ExitStack() as stack:
        planner = open_bus("planner", announce=True)
        planner_loop = Loop(planner)
        PlannerService(
            PlannerSettings(
                drive="unicycle", cameras=NUM, radius_m=0.8, elevation_deg=20.0, dt_s=DT_S
            ),
            planner,
            planner_loop,
        )
        mapper_bus = open_bus("mapper", announce=True)
        mapper_loop = Loop(mapper_bus)
        mapper = Mapper(mapper_bus, mapper_loop)
        loops = [planner_loop, mapper_loop]
        for camera in range(NUM):
            bus = open_bus("camera", str(camera), announce=True)
            loops.append(Loop(bus))
            PilotedCamera(bus, loops[-1], camera)
        simulator = open_bus("simulator")
        loops.append(Loop(simulator))
        Simulator(
            SimulatorSettings(
                object="box",
                cameras=NUM,
                semi_axes_m=(4.0, 3.2),
                lap_s=60.0,
                drive="unicycle",
                actuator_lag_s=0.1,
                max_ticks=TICKS,
                timeout_s=WAIT_S,
            ),
            simulator,
            loops[-1],
        )
        watcher = open_bus("watcher")
        clocks = stack.enter_context(watcher.subscribe(SIM_CLOCK))
        for loop in loops:
            stack.enter_context(running(loop))
        while clocks.get(WAIT_S).message.state != "finished":
            pass
        counted = watcher.request("simulator", "get", timeout_s=WAIT_S)
    assert sorted(mapper.states) == list(range(TICKS))
    assert np.abs([bearings(state) for state in mapper.states.values()]).max() <= ROOM_RAD
    assert (counted["sideways_commands"], counted["clipped_commands"]) == (0, 0)
    assert (counted["dropped"], counted["contacts"]) == ([], 0)
    moved = [state.cameras[0].pose.position for state in (mapper.states[0], mapper.states[59])]
    assert math.dist(*moved) > 0.5
