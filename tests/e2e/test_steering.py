"""A run of real processes is steered over the bus, as a panel or a program does it."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schemas.map import MapSummary
from schemas.metrics import Quality
from schemas.sim import SimState
from schemas.topics import CAMERA_GOAL, MAP_SUMMARY, QUALITY, SIM_CLOCK, SIM_STATE, Topic
from services.kernels.rigid import optical_yaw
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.reader import Reader
from services.runtime.settings import BusSettings

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300)]

PORT = 7471
FLAGS = (
    *("run", "--headless", "--no-viewer", "--forever", "--port", str(PORT)),
    *("--cameras", "3", "--resolution", "320x240", "--voxel-size", "0.02"),
    # Robots with wheels can keep this formation too.
    *("--semi-axes", "4.0", "3.2", "--lap", "60", "--radius", "0.8", "--vfov", "64.4"),
    *("--deformation", "rigid"),
)
WAIT_S = 60.0
FASTEST_M = 3.0 / 15
"""No camera flies farther than that between two instants."""


@contextmanager
def steered(folder: Path, *flags: str) -> Iterator[Bus]:
    """Start a run, yield a bus to steer it by, and end it; it must end well."""
    process = subprocess.Popen(
        [sys.executable, "-c", "from services.launcher.cli import main; main()", *FLAGS, *flags],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        with Bus(BusSettings(connect=f"tcp/127.0.0.1:{PORT}", shm_pool_mib=0), "user") as bus:
            until(bus, MAP_SUMMARY, lambda summary: summary.tick >= 2)
            yield bus
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, output
    assert "starting it again" not in output


def until(bus: Bus, topic: Topic[Any], reached: Callable[[Any], bool]) -> Any:
    """Wait for the first message of which `reached` is true."""
    with bus.latest(topic) as reader:
        return first(reader, reached)


def first(reader: Reader[Any], reached: Callable[[Any], bool]) -> Any:
    deadline_s, message = time.monotonic() + WAIT_S, None
    while time.monotonic() < deadline_s:
        message = reader.get(WAIT_S).message
        if reached(message):
            return message
    raise AssertionError(f"not within {WAIT_S} s; the last was {message}")


def answers(bus: Bus, service: str, name: str, value: object) -> None:
    """Wait until a service reports a value."""
    deadline_s = time.monotonic() + WAIT_S
    while (told := bus.request(service, "get"))[name] != value:
        assert time.monotonic() < deadline_s, told
        time.sleep(0.1)


def is_covered(quality: Quality) -> bool:
    """Whether nearly all that the cameras see is in the map, and little else."""
    score = quality.stamp_true[1]
    return score.coverage_visible > 0.9 and score.precision > 0.9


def fuses(*cameras: int) -> Callable[[MapSummary], bool]:
    return lambda summary: summary.cameras_used == cameras and not summary.cameras_missing


def distances(state: SimState) -> list[float]:
    """Return how far each camera is from the middle of the target, m."""
    centre = np.array(state.target.position) + [0.0, 0.0, state.scene.height_m / 2]
    return [float(np.linalg.norm(np.array(body.pose.position) - centre)) for body in state.cameras]


def mounting(state: SimState) -> float:
    """Return from where camera 0 moves to where it looks, rad; fixed for one on wheels."""
    body = state.cameras[0]
    course_rad = np.arctan2(body.twist.linear[1], body.twist.linear[0])
    return float(np.angle(np.exp(1j * (optical_yaw(body.pose.matrix()) - course_rad))))


def test_a_run_is_steered_in_all_that_can_be_steered(tmp_path: Path) -> None:
    with steered(tmp_path) as bus, bus.every(SIM_STATE) as states:
        first(states, lambda state: state.tick > 2)
        change_the_object(bus)
        change_the_number_of_cameras(bus)
        change_the_formation_and_the_drive(bus)
        change_the_memory(bus)
        facts = bus.request("simulator", "get")
        assert (facts["dropped"], facts["contacts"]) == ([], 0)
        nobody_has_jumped(states, facts["tick"])
        hold_step_and_begin_anew(bus)


@pytest.mark.slow
def test_a_run_in_real_time_is_steered_likewise(tmp_path: Path) -> None:
    with steered(tmp_path, "--mode", "realtime", "--rate", "5") as bus:
        bus.request("simulator", "set", {"object": "torus"}, timeout_s=WAIT_S)
        until(bus, SIM_STATE, lambda state: state.scene.object == "torus")
        bus.request("launcher", "set", {"cameras": 4})
        until(bus, MAP_SUMMARY, lambda summary: len(summary.cameras_used) == 4)
        bus.request("launcher", "set", {"cameras": 2})
        until(bus, MAP_SUMMARY, fuses(0, 1))
        hold_step_and_begin_anew(bus)


def change_the_object(bus: Bus) -> None:
    wanted = {"object": "torus", "deformation": "breathing"}
    told = bus.request("simulator", "set", wanted, timeout_s=WAIT_S)
    assert {name: told[name] for name in wanted} == wanted
    state = until(bus, SIM_STATE, lambda state: state.scene.object == "torus")
    until(bus, QUALITY, lambda quality: quality.tick > state.tick + 1 and is_covered(quality))
    with pytest.raises(CommandFailed, match=r"no object 'teapot'; known: bunny"):
        bus.request("simulator", "set", {"object": "teapot"}, timeout_s=WAIT_S)
    with pytest.raises(CommandFailed, match=r"height_m must be at most 0.5, got 5"):
        bus.request("simulator", "set", {"height_m": 5}, timeout_s=WAIT_S)
    bus.request("simulator", "set", {"object": "bunny", "height_m": 0.5}, timeout_s=WAIT_S)
    state = until(bus, SIM_STATE, lambda state: state.scene.height_m == 0.5)
    until(bus, QUALITY, lambda quality: quality.tick > state.tick + 1 and is_covered(quality))
    answers(bus, "planner", "centre_height_m", 0.25)


def change_the_number_of_cameras(bus: Bus) -> None:
    assert bus.request("launcher", "set", {"cameras": 5})["starting"] == [3, 4]
    until(bus, MAP_SUMMARY, fuses(0, 1, 2, 3, 4))
    answers(bus, "launcher", "running", [0, 1, 2, 3, 4])
    assert bus.request("planner", "get")["cameras"] == 5
    bus.request("launcher", "set", {"cameras": 2})
    until(bus, MAP_SUMMARY, fuses(0, 1))
    answers(bus, "launcher", "ending", [])
    answers(bus, "simulator", "cameras", [0, 1])
    assert not {"camera/2", "camera/3", "camera/4"} & bus.presence.everybody()
    bus.request("launcher", "set", {"cameras": 3})
    until(bus, MAP_SUMMARY, fuses(0, 1, 2))
    with pytest.raises(CommandFailed, match=r"cameras: .*less than or equal to 64 \(got 65\)"):
        bus.request("launcher", "set", {"cameras": 65})


def change_the_formation_and_the_drive(bus: Bus) -> None:
    bus.request("planner", "set", {"radius_m": 0.9, "elevation_deg": 30})
    until(bus, SIM_STATE, lambda state: np.allclose(distances(state), 0.9, atol=0.02))
    bus.request("planner", "set", {"radius_m": 0.8, "elevation_deg": 20})
    until(bus, SIM_STATE, lambda state: np.allclose(distances(state), 0.8, atol=0.02))

    bus.request("planner", "set", {"drive": "unicycle"})
    goal = until(bus, CAMERA_GOAL, lambda goal: goal.robot is not None and goal.camera == 0)
    driving = until(bus, SIM_STATE, lambda state: state.tick > goal.tick + 5)
    # On wheels it moves along its heading, to which the camera is fixed, whatever the curve.
    assert goal.robot is not None
    off_rad = mounting(driving) - goal.robot.camera_yaw_rad
    assert min(abs(np.angle(np.exp(1j * (off_rad + turn)))) for turn in (0, np.pi)) < 0.01
    assert driving.cameras[0].twist.linear[2] == 0.0
    until(bus, QUALITY, lambda quality: quality.tick > driving.tick and is_covered(quality))
    bus.request("planner", "set", {"drive": "flying", "elevation_deg": 40})
    goal = until(bus, CAMERA_GOAL, lambda goal: goal.robot is None)
    until(bus, SIM_STATE, lambda state: any(body.twist.linear[2] > 0.05 for body in state.cameras))


def change_the_memory(bus: Bus) -> None:
    bus.request("mapper", "set", {"memory": "persistent", "frames_to_clear": 2})
    summary = until(bus, MAP_SUMMARY, lambda summary: summary.memory == "persistent")
    # Another object: what the map knew of the last one is forgotten.
    bus.request("simulator", "set", {"object": "sphere", "height_m": 0.4}, timeout_s=WAIT_S)
    state = until(bus, SIM_STATE, lambda state: state.scene.object == "sphere")
    assert state.tick > summary.tick
    until(bus, QUALITY, lambda quality: quality.tick > state.tick + 15 and is_covered(quality))


def hold_step_and_begin_anew(bus: Bus) -> None:
    assert bus.request("simulator", "pause")["state"] == "paused"
    until(bus, SIM_CLOCK, lambda clock: clock.state == "paused" and not clock.waiting_for)
    tick = bus.request("simulator", "get")["tick"]
    with bus.latest(MAP_SUMMARY) as summaries:
        bus.request("simulator", "step", {"ticks": 3})
        first(summaries, lambda summary: summary.tick == tick + 3)
    assert bus.request("simulator", "get")["tick"] == tick + 3
    bus.request("simulator", "reset")
    until(bus, SIM_CLOCK, lambda clock: clock.state == "paused" and clock.tick == 0)
    bus.request("simulator", "resume")
    until(bus, QUALITY, lambda quality: 2 < quality.tick < tick and is_covered(quality))


def nobody_has_jumped(states: Reader[SimState], tick: int) -> None:
    """Neither the target nor any camera."""
    told = [states.get(WAIT_S).message]
    while told[-1].tick < tick:
        told.append(states.get(WAIT_S).message)
    for before, after in pairwise(told):
        ticks = after.tick - before.tick
        where = {body.camera: body.pose.position for body in before.cameras}
        where[-1] = before.target.position
        now = {body.camera: body.pose.position for body in after.cameras}
        now[-1] = after.target.position
        for body in where.keys() & now.keys():
            assert np.linalg.norm(np.subtract(now[body], where[body])) <= ticks * FASTEST_M + 1e-9
