"""The world changes while it runs: object, deformation, number of cameras, drive."""

import threading
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from schemas.camera import CameraCommand, CameraGoal, RobotGoal
from schemas.geometry import Twist
from schemas.topics import CAMERA_COMMAND, CAMERA_GOAL, SIM_STATE
from services.kernels.rigid import look_at
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.later import Later
from services.runtime.loop import Loop
from services.simulator.service import Simulator
from services.simulator.settings import SimulatorSettings
from tests.integration.conftest import running
from tests.integration.test_simulator_service import (
    WAIT_S,
    Partners,
    goal_of,
    simulating,
    wait_for_clock,
)

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]
TETRAHEDRON = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def until(partners: Partners, reached: Callable[..., bool]) -> None:
    """Wait for the first state of which `reached` is true."""
    tick = 0
    while not reached(state := partners.wait_for_tick(tick)):
        tick = state.tick + 1


def refusal(user: Bus, params: dict[str, object]) -> str | None:
    """Return why the simulator does not take a change on; None if it does."""
    try:
        user.request("simulator", "set", params, timeout_s=WAIT_S)
    except CommandFailed as error:
        return str(error)
    return None


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_object_and_deformation_change_between_two_ticks_and_the_target_goes_on(
    open_bus: OpenBus, mode: str
) -> None:
    user = open_bus("user")
    with simulating(open_bus, mode=mode, dt_s=0.02, lap_s=4.0) as partners:
        partners.wait_for_tick(2)
        told = user.request("simulator", "set", {"object": "torus", "deformation": "twist:0.5:1"})
        assert (told["object"], told["deformation"]) == ("torus", "twist:0.5:1")
        until(partners, lambda state: state.scene.object == "torus")
        user.request("simulator", "set", {"height_m": 0.3, "deformation": "rigid"})
        until(partners, lambda state: state.scene.height_m == 0.3)
        states = partners.states
    kinds = [tuple(d.kind for d in state.scene.deformations) for state in states]
    assert kinds == sorted(kinds, key=[(), ("twist",), ()].index) or len(set(kinds)) == 2
    motion = SimulatorSettings(dt_s=0.02, lap_s=4.0).motion()
    for state in states:
        np.testing.assert_allclose(
            state.target.matrix(), motion.at(state.t_ns * 1e-9).pose(), atol=1e-9
        )
    for before, after in pairwise(states):
        same_time_alike = before.tick != after.tick or before.scene == after.scene
        assert same_time_alike or mode == "realtime"


@pytest.mark.parametrize(
    ("params", "says"),
    [
        ({"object": "teapot"}, r"no object 'teapot'; known: bunny, sphere, box, torus, or a file"),
        ({"object": "no/such.obj"}, r"no file 'no/such.obj'; built in: bunny"),
        ({"deformation": "melting"}, r"no deformation 'melting'; known: rigid, breathing"),
        ({"deformation": "bend:3"}, r"amplitude: .* less than or equal to 2"),
        ({"deformation": "squash:0.9"}, r"squash amplitude must be 0..0.8, got 0.9"),
        ({"height_m": -1}, r"height_m: .* greater than 0 \(got -1\)"),
        ({"height_m": 0.6}, r"height_m must be at most 0.5, got 0.6"),
        ({"cameras": 0}, r"cameras: .* greater than or equal to 1"),
        ({"colour": "red"}, r"unknown parameter 'colour'; known: object, up, height_m, subdivide"),
    ],
)
def test_a_wrong_change_is_refused_with_the_rule_and_changes_nothing(
    open_bus: OpenBus, params: dict[str, object], says: str
) -> None:
    bus, user = open_bus("simulator"), open_bus("user")
    loop = Loop(bus)
    Simulator(SimulatorSettings(object="box", max_height_m=0.5), bus, loop)
    with running(loop):
        before = user.request("simulator", "get")
        with pytest.raises(CommandFailed, match=says):
            user.request("simulator", "set", params, timeout_s=WAIT_S)
        assert user.request("simulator", "get") == before


def test_a_mesh_that_a_camera_cannot_load_is_refused_in_its_name(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    """The file is here, and not where that camera runs."""
    mesh = tmp_path / "tetrahedron.off"
    mesh.write_text(TETRAHEDRON)
    user = open_bus("user")
    with simulating(open_bus, cameras=1) as partners:
        partners.wait_for_tick(1)

        def prepare(params: dict[str, object]) -> Later[object]:
            if params["scene"]["object"] == str(mesh):
                raise ValueError(f"no file {mesh}")
            return Later(lambda: None, lambda _: {})

        camera = open_bus("camera", "7")
        loop = Loop(camera)
        loop.serve_later("prepare", prepare)
        with running(loop):
            says = None
            while says is None:  # The simulator may not know of that camera at first.
                says = refusal(user, {"object": str(mesh)})
                assert refusal(user, {"object": "box"}) is None
        assert f"ctl/camera/7/prepare: ValueError: no file {mesh}" in says
        camera.close()
        told = user.request("simulator", "get")
        assert told["object"] == "box"


def test_while_somebody_loads_ticks_go_on_and_requests_are_carried_out_in_turn(
    open_bus: OpenBus,
) -> None:
    user, loaded = open_bus("user"), threading.Event()
    with simulating(open_bus, cameras=1) as partners:
        loop = Loop(open_bus("camera", "5"))
        loop.serve_later("prepare", lambda _: Later(loaded.wait, lambda _: {}))
        with running(loop):
            loaded.set()
            user.request("camera", "prepare", instance="5", timeout_s=WAIT_S)
            loaded.clear()
            answers: list[dict[str, object]] = []

            def ask(params: dict[str, object]) -> threading.Thread:
                thread = threading.Thread(
                    target=lambda: answers.append(
                        user.request("simulator", "set", params, timeout_s=WAIT_S)
                    )
                )
                thread.start()
                return thread

            first = ask({"object": "torus"})
            tick = partners.wait_for_tick(3).tick
            partners.wait_for_tick(tick + 20)
            assert not answers
            assert {state.scene.object for state in partners.states} == {"box"}
            loaded.set()
            first.join(WAIT_S)
            ask({"height_m": 0.3}).join(WAIT_S)
            until(partners, lambda state: state.scene.height_m == 0.3)
    assert [(a["object"], a["height_m"]) for a in answers] == [("torus", 0.4), ("torus", 0.3)]


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_cameras_join_when_they_are_there_and_leave_without_a_stall(
    open_bus: OpenBus, mode: str
) -> None:
    user = open_bus("user")
    with simulating(open_bus, cameras=3, mode=mode, dt_s=0.02, timeout_s=10 * WAIT_S) as partners:
        assert len(partners.wait_for_tick(2).cameras) == 3
        told = user.request("simulator", "set", {"cameras": 2})
        assert told["expected_cameras"] == 2
        until(partners, lambda state: len(state.cameras) == 2)
        user.request("simulator", "set", {"cameras": 4})
        # Camera 2 is alive; nobody plans for camera 3, and nobody waits for it.
        until(partners, lambda state: [b.camera for b in state.cameras] == [0, 1, 2])
        last = partners.states[-1].tick
        partners.wait_for_tick(last + 10)
        assert user.request("simulator", "get")["dropped"] == []


@pytest.fixture
def planned(open_bus: OpenBus) -> Iterator[tuple[Bus, Callable[..., object]]]:
    """A world of one camera, whose planner and camera we play; the mapper is not waited for."""
    bus, loop_bus = open_bus("planner", announce=True), open_bus("simulator")
    open_bus("camera", "0", announce=True)
    loop = Loop(loop_bus)
    settings = SimulatorSettings(object="box", cameras=1, wait_for=("planner",), drive="planned")
    Simulator(settings, loop_bus, loop)
    states = bus.latest(SIM_STATE)
    seen = -1

    def tick(robot: RobotGoal | None, twist: Twist) -> object:
        """Play one tick; return the state after it."""
        nonlocal seen
        goal = goal_of(0, max(seen, 0), 0)
        goal = CameraGoal.model_validate({**goal.model_dump(), "robot": robot})
        while True:
            bus.publish(CAMERA_GOAL, goal, camera=0)
            if seen >= 0:
                yaw = None if robot is None else robot.camera_yaw_rad
                command = CameraCommand(
                    t_ns=0, tick=seen, frame_id="world", camera=0, twist=twist, camera_yaw_rad=yaw
                )
                bus.publish(CAMERA_COMMAND, command, camera=0)
            try:
                state = states.get(1.0).message
            except TimeoutError:
                continue
            if state.tick > seen:
                seen = state.tick
                return state

    with running(loop), states:
        yield bus, tick


def test_a_camera_stands_on_wheels_from_the_command_on_that_says_so(planned) -> None:
    _, tick = planned
    up = Twist(linear=(0.0, 0.0, 0.3), angular=(0.0, 0.0, 0.0))
    sideways = Twist(linear=(0.0, 0.6, 0.3), angular=(0.0, 0.0, 0.0))
    # The camera looks along -x; its robot, turned by pi/2 against it, heads along y.
    T = look_at([np.cos(0), np.sin(0), 0.6], [0, 0, 0.2])
    assert T[0, 2] < 0
    robot = RobotGoal(heading_rad=0, v_mps=0, omega_rps=0, v_dot=0, camera_yaw_rad=np.pi / 2)
    heights = [tick(None, up).cameras[0].pose.position[2] for _ in range(3)]
    assert heights[2] > heights[1]
    driven = [tick(robot, sideways).cameras[0].pose.position for _ in range(3)]
    assert driven[-1][2] == pytest.approx(driven[0][2])  # Wheels do not climb ...
    assert abs(driven[-1][1] - driven[0][1]) == pytest.approx(2 * 0.6 / 15, rel=1e-3)
    flown = [tick(None, up).cameras[0].pose.position for _ in range(2)]
    assert flown[-1][2] > driven[-1][2] + 0.01  # ... and wings do.


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_pause_step_resume_reset_in_both_modes(open_bus: OpenBus, mode: str) -> None:
    user = open_bus("user")
    with simulating(open_bus, cameras=1, mode=mode, dt_s=0.02) as partners:
        partners.wait_for_tick(2)
        user.request("simulator", "pause")
        wait_for_clock(user, "paused")
        user.request("simulator", "set", {"deformation": "bend"})
        tick = user.request("simulator", "get")["tick"]
        user.request("simulator", "step", {"ticks": 2})
        partners.wait_for_tick(tick + 2)
        wait_for_clock(user, "paused", ())
        assert user.request("simulator", "get")["tick"] == tick + 2
        assert partners.states[-1].scene.deformations[0].kind == "bend"
        with user.latest(SIM_STATE) as states:
            user.request("simulator", "reset")
            while states.get(WAIT_S).message.tick != 0:
                pass
        wait_for_clock(user, "paused")
        assert user.request("simulator", "get")["tick"] == 0
        assert user.request("simulator", "get")["deformation"] == "bend"
        user.request("simulator", "resume")
        with user.latest(SIM_STATE) as states:
            while states.get(WAIT_S).message.tick < 3:
                pass
