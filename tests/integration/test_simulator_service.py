"""The simulator on a real bus, with a scripted partner for each service it works with."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise

import numpy as np
import pytest

from schemas.camera import CameraCommand, CameraGoal
from schemas.geometry import Pose, Twist
from schemas.map import MapSummary
from schemas.sim import SimState
from schemas.topics import (
    CAMERA_COMMAND,
    CAMERA_GOAL,
    MAP_SUMMARY,
    SIM_CLOCK,
    SIM_STATE,
    TARGET_OBSERVATION,
    TARGET_POSE,
)
from services.kernels.rigid import apply, integrate_twist, look_at
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.loop import Loop
from services.simulator.service import Simulator
from services.simulator.settings import SimulatorSettings
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]
WAIT_S = 20.0


def goal_of(camera: int, tick: int, t_ns: int) -> CameraGoal:
    pose = Pose.from_matrix(look_at([np.cos(camera), np.sin(camera), 0.6], [0, 0, 0.2]))
    rest = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
    return CameraGoal(t_ns=t_ns, tick=tick, frame_id="world", camera=camera, pose=pose, twist=rest)


def command_of(camera: int, tick: int, t_ns: int) -> CameraCommand:
    wave = np.random.default_rng([camera, tick]).uniform(-0.3, 0.3, 6).tolist()
    twist = Twist(linear=tuple(wave[:3]), angular=tuple(wave[3:]))
    return CameraCommand(t_ns=t_ns, tick=tick, frame_id="world", camera=camera, twist=twist)


def summary_of(tick: int, t_ns: int) -> MapSummary:
    return MapSummary(
        t_ns=t_ns,
        tick=tick,
        frame_id="target",
        rev=tick,
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


class Partners:
    """A planner, cameras and a mapper that do as the protocol says and nothing more."""

    def __init__(self, open_bus: OpenBus, stack: ExitStack, cameras: int) -> None:
        self.states: list[SimState] = []
        self.silent: set[int] = set()
        """Cameras that do not acknowledge."""
        self.cameras: list[ExitStack] = []
        """Close one and its process is gone."""
        self._seen = threading.Condition()
        planner = open_bus("planner", announce=True)
        mapper = open_bus("mapper", announce=True)
        self._loop(planner, stack).on(
            TARGET_POSE, lambda r: self._plan(planner, r.message, cameras)
        )
        self._loop(mapper, stack).on(SIM_STATE, lambda r: self._fuse(mapper, r.message))
        for camera in range(cameras):
            bus, own = (
                open_bus("camera", str(camera), announce=True),
                stack.enter_context(ExitStack()),
            )
            own.callback(bus.close)
            self._loop(bus, own).on(SIM_STATE, self._camera(bus, camera))
            self.cameras.append(own)

    def _loop(self, bus: Bus, stack: ExitStack) -> Loop:
        loop = Loop(bus)
        stack.enter_context(running(loop))
        return loop

    def _plan(self, bus: Bus, target, cameras: int) -> None:
        for camera in range(cameras):
            bus.publish(CAMERA_GOAL, goal_of(camera, target.tick, target.t_ns), camera=camera)

    def _camera(self, bus: Bus, camera: int) -> Callable[..., None]:
        def on_state(received) -> None:
            state = received.message
            if camera not in self.silent:
                command = command_of(camera, state.tick, state.t_ns)
                bus.publish(CAMERA_COMMAND, command, camera=camera)

        return on_state

    def _fuse(self, bus: Bus, state: SimState) -> None:
        with self._seen:
            self.states.append(state)
            self._seen.notify_all()
        bus.publish(MAP_SUMMARY, summary_of(state.tick, state.t_ns))

    def wait_for_tick(self, tick: int) -> SimState:
        with self._seen:
            assert self._seen.wait_for(
                lambda: bool(self.states) and self.states[-1].tick >= tick, WAIT_S
            )
            return self.states[-1]


@contextmanager
def simulating(open_bus: OpenBus, cameras: int = 2, **settings: object) -> Iterator[Partners]:
    """Run a simulator of a small world with its partners."""
    chosen = SimulatorSettings(object="box", cameras=cameras, **settings)
    with ExitStack() as stack:
        bus = open_bus("simulator")
        loop = Loop(bus)
        Simulator(chosen, bus, loop)
        partners = Partners(open_bus, stack, cameras)
        stack.enter_context(running(loop))
        yield partners


def wait_for_clock(bus: Bus, state: str, waiting_for: tuple[str, ...] | None = None) -> None:
    with bus.subscribe(SIM_CLOCK) as clocks:
        while True:
            clock = clocks.get(WAIT_S).message
            if clock.state == state and waiting_for in (None, clock.waiting_for):
                return


def test_lockstep_runs_every_tick_once_and_each_command_is_flown(open_bus: OpenBus) -> None:
    with simulating(open_bus, max_ticks=12) as partners:
        partners.wait_for_tick(11)
        wait_for_clock(open_bus("watcher"), "finished")
    states = partners.states
    assert [state.tick for state in states] == list(range(12))
    for before, after in pairwise(states):
        assert after.t_ns == after.tick * after.dt_ns
        for one, two in zip(before.cameras, after.cameras, strict=True):
            twist = command_of(one.camera, before.tick, 0).twist
            assert two.twist == twist
            dt_s = before.dt_ns * 1e-9
            T = integrate_twist(one.pose.matrix(), twist.linear, twist.angular, dt_s)
            np.testing.assert_allclose(two.pose.matrix(), T, atol=1e-9)


def test_cameras_spawn_at_their_first_goals(open_bus: OpenBus) -> None:
    with simulating(open_bus, max_ticks=1) as partners:
        state = partners.wait_for_tick(0)
    assert [body.camera for body in state.cameras] == [0, 1]
    for body in state.cameras:
        expected = goal_of(body.camera, 0, 0).pose.matrix()
        np.testing.assert_allclose(body.pose.matrix(), expected, atol=1e-12)


def test_two_runs_go_through_the_same_states(open_bus: OpenBus) -> None:
    runs = []
    for _ in range(2):
        with simulating(open_bus, max_ticks=8, deformation="squash") as partners:
            partners.wait_for_tick(7)
        runs.append(partners.states)
    assert runs[0] == runs[1]


def test_before_all_are_there_the_clock_waits_and_names_them(open_bus: OpenBus) -> None:
    bus, watcher = open_bus("simulator"), open_bus("watcher")
    loop = Loop(bus)
    Simulator(SimulatorSettings(object="box", cameras=1), bus, loop)
    with running(loop), watcher.subscribe(TARGET_POSE) as poses:
        assert poses.get(WAIT_S).message.tick == 0
        wait_for_clock(watcher, "waiting", ("camera/0", "mapper", "planner"))
        open_bus("mapper", announce=True)
        wait_for_clock(watcher, "waiting", ("camera/0", "planner"))


def test_a_silent_camera_is_named_dropped_and_taken_back(open_bus: OpenBus) -> None:
    watcher = open_bus("watcher")
    with simulating(open_bus, timeout_s=0.5) as partners, watcher.subscribe(SIM_CLOCK) as clocks:
        partners.wait_for_tick(3)
        partners.silent.add(1)

        def until_dropped(names: tuple[str, ...]) -> int:
            while (clock := clocks.get(WAIT_S).message).dropped != names:
                pass
            return clock.tick

        at = until_dropped(("camera/1",))
        # It stands still while it is silent.
        later = partners.wait_for_tick(at + 3)
        assert not np.any(later.cameras[1].twist.linear)
        partners.silent.clear()
        until_dropped(())


def test_a_camera_that_leaves_the_bus_is_not_waited_for(open_bus: OpenBus) -> None:
    with simulating(open_bus, timeout_s=10 * WAIT_S) as partners:
        state = partners.wait_for_tick(2)
        partners.cameras[1].close()
        partners.wait_for_tick(state.tick + 20)
        assert open_bus("watcher").request("simulator", "get")["dropped"] == []


def test_pause_step_resume_and_reset(open_bus: OpenBus) -> None:
    watcher = open_bus("watcher")
    with simulating(open_bus) as partners:
        partners.wait_for_tick(2)
        tick = watcher.request("simulator", "pause")["tick"]
        # The acknowledgements of the tick at hand may still come in: it is held all the same.
        watcher.request("simulator", "step", {"ticks": 3})
        partners.wait_for_tick(tick + 3)
        wait_for_clock(watcher, "paused")
        assert watcher.request("simulator", "get")["tick"] == tick + 3
        watcher.request("simulator", "resume")
        partners.wait_for_tick(tick + 5)
        with pytest.raises(CommandFailed, match="the clock is running; step needs it paused"):
            watcher.request("simulator", "step")
        with watcher.subscribe(SIM_STATE) as states:
            watcher.request("simulator", "reset")
            for tick in (0, 3):
                while states.get(WAIT_S).message.tick != tick:
                    pass


@pytest.mark.parametrize("ticks", [0, -1, "many", 1.5])
def test_a_wrong_step_is_refused_with_the_rule(open_bus: OpenBus, ticks: object) -> None:
    bus = open_bus("simulator")
    loop = Loop(bus)
    Simulator(SimulatorSettings(object="box"), bus, loop)
    with running(loop), pytest.raises(CommandFailed, match="ticks must be a whole number"):
        open_bus("watcher").request("simulator", "step", {"ticks": ticks})


def test_real_time_waits_for_nobody_and_keeps_its_rate(open_bus: OpenBus) -> None:
    watcher = open_bus("watcher")
    with (
        simulating(open_bus, mode="realtime", dt_s=0.02, command_timeout_s=0.1) as partners,
        watcher.subscribe(SIM_CLOCK) as clocks,
    ):
        partners.wait_for_tick(1)
        partners.silent.update({0, 1})
        first = clocks.get(WAIT_S).message
        while (last := clocks.get(WAIT_S).message).tick < first.tick + 50:
            pass
        elapsed_s = (last.t_wall_ns - first.t_wall_ns) * 1e-9
        ticks = last.tick - first.tick
        # Never faster than the wall clock, slower only by the ticks it says came late.
        assert elapsed_s > (ticks - 1) * 0.02
        assert last.dropped == ()
        state = partners.wait_for_tick(last.tick)
        assert not np.any(state.cameras[0].twist.linear)  # without commands they stand.


def test_the_target_pose_is_that_of_the_state(open_bus: OpenBus) -> None:
    watcher = open_bus("watcher")
    with simulating(open_bus, cameras=1) as partners, watcher.subscribe(TARGET_POSE) as poses:
        partners.wait_for_tick(1)
        while (pose := poses.get(WAIT_S).message).tick < 3:
            pass
        state = partners.wait_for_tick(pose.tick)
        twin = next(s for s in partners.states if s.tick == pose.tick)
        assert (pose.pose, pose.twist, pose.t_ns) == (twin.target, twin.twist, twin.t_ns)
        assert state.tick >= pose.tick
        assert apply(pose.pose.matrix(), [0, 0, 0])[2] == 0.0


def test_the_tracker_speaks_at_every_tick_and_the_same_in_every_run(open_bus: OpenBus) -> None:
    runs = []
    for _ in range(2):
        tracker = {"target_noise_m": 0.02, "target_delay_s": 0.1, "target_dropout": 0.3}
        watcher = open_bus("watcher")
        with (
            watcher.every(TARGET_OBSERVATION) as told,
            simulating(open_bus, max_ticks=12, **tracker) as partners,
        ):
            partners.wait_for_tick(11)
            found: dict[int, object] = {}
            while 11 not in found:
                message = told.get(WAIT_S).message
                assert found.setdefault(message.tick, message) == message
        runs.append(found)
    assert runs[0] == runs[1]
    assert set(runs[0]) == set(range(12))
    assert len({str(message.sighting) for message in runs[0].values()}) > 6
