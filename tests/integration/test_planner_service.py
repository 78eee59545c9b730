"""The planner on a real bus: goals for every camera at every pose of the target."""

import re
import threading
from contextlib import ExitStack, contextmanager, suppress

import numpy as np
import pytest

from schemas.camera import CameraPose
from schemas.geometry import Pose, Twist
from schemas.target import TargetPose
from schemas.topics import CAMERA_GOAL, CAMERA_POSE, FORMATION, TARGET_POSE
from services.kernels.rigid import look_at, planar
from services.planner import gate
from services.planner.errors import InfeasibleError
from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.loop import Loop
from services.runtime.settings import BusSettings

pytestmark = pytest.mark.integration

TIMEOUT_S = 5.0
DT_S = 0.1
NUM_CAMERAS = 6


def quiet(endpoint):
    return BusSettings(connect=endpoint, shm_pool_mib=0)


@contextmanager
def running(endpoint, **told):
    with Bus(quiet(endpoint), "planner") as bus:
        loop = Loop(bus)
        settings = PlannerSettings(bus=quiet(endpoint), cameras=NUM_CAMERAS, dt_s=DT_S, **told)
        PlannerService(settings, bus, loop)
        thread = threading.Thread(target=loop.run)
        thread.start()
        try:
            yield bus
        finally:
            loop.stop()
            thread.join(TIMEOUT_S)


@pytest.fixture
def planner(endpoint):
    """The bus of a running planner."""
    with running(endpoint) as bus:
        yield bus


@pytest.fixture
def user(endpoint, planner):  # noqa: ARG001 it runs.
    """A bus beside a running planner."""
    with ExitStack() as stack:
        bus = stack.enter_context(Bus(quiet(endpoint), "test"))
        while not bus.matching(TARGET_POSE):
            threading.Event().wait(0.01)
        yield bus


def target(tick, x_m=0.0, speed_m_s=0.5):
    return TargetPose(
        t_ns=int(tick * DT_S * 1e9),
        tick=tick,
        frame_id="world",
        pose=Pose.from_matrix(planar(x_m, 0, 0)),
        twist=Twist(linear=(speed_m_s, 0, 0), angular=(0, 0, 0)),
    )


def test_each_pose_of_the_target_brings_a_goal_for_every_camera(user):
    with user.subscribe(CAMERA_GOAL) as goals:
        user.publish(TARGET_POSE, target(7))
        received = [goals.get(TIMEOUT_S) for _ in range(NUM_CAMERAS)]
    assert sorted(each.camera for each in received) == list(range(NUM_CAMERAS))
    assert {each.message.tick for each in received} == {7}
    for each in received:
        np.testing.assert_allclose(each.message.twist.linear, [0.5, 0, 0], atol=1e-12)


def test_the_formation_is_where_the_target_will_be_at_the_next_instant(user):
    with user.subscribe(FORMATION) as formations:
        user.publish(TARGET_POSE, target(3, x_m=1.0))
        formation = formations.get(TIMEOUT_S).message
    assert formation.strategy == "circle"
    np.testing.assert_allclose(formation.centre, [1.0 + 0.5 * DT_S, 0, 0.2])
    assert len(formation.polygon) == len(formation.references) == NUM_CAMERAS


def test_the_formation_can_be_changed_while_running(user):
    changed = user.request("planner", "set", {"cameras": 3, "radius_m": 2.0}, timeout_s=TIMEOUT_S)
    assert changed == user.request("planner", "get", timeout_s=TIMEOUT_S)
    with user.subscribe(FORMATION) as formations:
        user.publish(TARGET_POSE, target(0))
        formation = formations.get(TIMEOUT_S).message
    assert len(formation.references) == 3
    assert formation.radius_m == 2.0


@pytest.mark.parametrize(
    ("params", "complaint"),
    [
        ({"cameras": 0}, "cameras = 0: .* greater than or equal to 1"),
        ({"speed": 1}, "no setting speed; known: strategy, cameras"),
        ({"strategy": "dome", "view_file": "/none"}, "/none: cannot be read"),
    ],
)
def test_a_bad_change_is_refused_and_changes_nothing(user, params, complaint):
    before = user.request("planner", "get", timeout_s=TIMEOUT_S)
    with pytest.raises(CommandFailed, match=complaint):
        user.request("planner", "set", params, timeout_s=TIMEOUT_S)
    assert user.request("planner", "get", timeout_s=TIMEOUT_S) == before


def next_formation(user, formations, tick):
    user.publish(TARGET_POSE, target(tick, speed_m_s=0.0))
    return formations.get(TIMEOUT_S).message


def wait_until(user, formations, ticks, condition):
    """Let instants pass until a formation is as it should be; return it and how many passed."""
    for tick in ticks:
        formation = next_formation(user, formations, tick)
        if condition(formation):
            return formation, tick
    raise AssertionError(formation)


def gaps_rad(formation):
    corners = np.array(formation.polygon) - formation.centre
    theta = np.sort(np.arctan2(corners[:, 1], corners[:, 0]))
    return np.diff(np.append(theta, theta[0] + 2 * np.pi))


def is_even(num):
    def check(formation):
        return len(formation.polygon) == num and np.allclose(gaps_rad(formation), 2 * np.pi / num)

    return check


def test_a_camera_that_dies_is_closed_in_on_within_a_second_and_let_in_again(
    user, planner, open_bus
):
    buses = [open_bus("camera", str(index), announce=True) for index in range(NUM_CAMERAS)]
    # Who was never there cannot be missed.
    while not {f"camera/{index}" for index in range(NUM_CAMERAS)} <= planner.presence.everybody():
        threading.Event().wait(0.01)
    with user.subscribe(FORMATION) as formations:
        _, now = wait_until(user, formations, range(1000), is_even(NUM_CAMERAS))
        buses[2].close()
        ticks = range(now + 1, 20_000)
        noticed, now = wait_until(user, formations, ticks, lambda f: len(f.references) == 5)
        assert [view.camera for view in noticed.references].count(2) == 0
        _, even = wait_until(user, formations, range(now + 1, now + 12), is_even(5))
        assert (even - now) * DT_S <= 1.0
        open_bus("camera", "2", announce=True)
        ticks = range(even + 1, 20_000)
        back, now = wait_until(user, formations, ticks, lambda f: len(f.references) == 6)
        assert 2 in [view.camera for view in back.references]
        wait_until(user, formations, range(now + 1, now + 60), is_even(6))


def test_a_camera_that_comes_starts_from_where_it_is(user, open_bus):
    body = Pose.from_matrix(look_at((2.0, 0.5, 1.0), (0, 0, 0.2)))
    rest = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
    camera = open_bus("camera", "6", announce=True)
    while not camera.matching(CAMERA_POSE, 6):
        threading.Event().wait(0.01)
    where = CameraPose(t_ns=0, tick=0, frame_id="world", camera=6, pose=body, twist=rest)
    with user.subscribe(FORMATION) as formations, user.subscribe(CAMERA_GOAL, camera=6) as goals:
        next_formation(user, formations, 0)
        camera.publish(CAMERA_POSE, where, camera=6)
        goal, tick = None, 0
        while goal is None:
            tick += 1
            next_formation(user, formations, tick)
            with suppress(TimeoutError):
                goal = goals.get(0.02)
        np.testing.assert_allclose(goal.message.pose.position, body.position, atol=0.1)
        user.request("planner", "set", {"cameras": 7}, timeout_s=TIMEOUT_S)
        wait_until(user, formations, range(tick + 1, tick + 80), is_even(7))


def test_a_change_of_radius_is_flown_and_not_jumped(user):
    with user.subscribe(FORMATION) as formations:
        before = next_formation(user, formations, 0)
        user.request("planner", "set", {"radius_m": 2.0}, timeout_s=TIMEOUT_S)
        last = np.array([view.pose.position for view in before.references])
        for tick in range(1, 40):
            now = next_formation(user, formations, tick)
            eyes = np.array([view.pose.position for view in now.references])
            assert np.linalg.norm(eyes - last, axis=1).max() < 2.0 * DT_S
            last = eyes
        np.testing.assert_allclose(np.linalg.norm(last - now.centre, axis=1), 2.0)


def test_the_drive_can_be_changed_while_running(user):
    robots = []
    with user.subscribe(CAMERA_GOAL) as goals:
        for drive, ticks in (("flying", 1), ("unicycle", 12), ("flying", 1)):
            user.request("planner", "set", {"drive": drive}, timeout_s=TIMEOUT_S)
            for _ in range(ticks):
                user.publish(TARGET_POSE, target(len(robots)))
                robots.append([goals.get(TIMEOUT_S).message.robot for _ in range(NUM_CAMERAS)])
    flying, *_, wheels, again = robots
    assert flying == [None] * NUM_CAMERAS
    assert all(robot.v_mps == pytest.approx(0.5) for robot in wheels)  # Views are turned by now.
    assert again == [None] * NUM_CAMERAS


@contextmanager
def asking(endpoint, **settings):
    """A user beside a planner with limits."""
    with running(endpoint, **settings), Bus(quiet(endpoint), "test") as bus:
        while not bus.matching(TARGET_POSE):
            threading.Event().wait(0.01)
        yield bus


def turning(tick, omega_rps):
    told = target(tick)
    twist = Twist(linear=told.twist.linear, angular=(0, 0, omega_rps))
    return told.model_copy(update={"twist": twist})


def test_what_cannot_be_is_refused_with_what_would_do_and_nothing_changes(endpoint):
    with asking(endpoint, beta_deg=40, target_radius_m=0.1) as user:
        with user.subscribe(FORMATION) as formations:
            for tick, omega_rps in enumerate((0.2, 0.0)):  # The turn is over, and not forgotten.
                user.publish(TARGET_POSE, turning(tick, omega_rps))
                formations.get(TIMEOUT_S)
        before = user.request("planner", "get", timeout_s=TIMEOUT_S)
        wheels = {"drive": "unicycle", "radius_m": 2.0}
        with pytest.raises(CommandFailed) as refused:
            user.request("planner", "set", wheels, timeout_s=TIMEOUT_S)
        assert user.request("planner", "get", timeout_s=TIMEOUT_S) == before
        found = re.search(
            r"max \|beta_ri\| \+ beta_R <= beta is violated, [\d.]+ > 40 deg; "
            r"nearest feasible radius_m = ([\d.]+)",
            str(refused.value),
        )
        feasible = wheels | {"radius_m": float(found[1])}
        assert user.request("planner", "set", feasible, timeout_s=TIMEOUT_S)["drive"] == "unicycle"
        allowed = wheels | {"infeasible": "allow"}
        assert user.request("planner", "set", allowed, timeout_s=TIMEOUT_S)["radius_m"] == 2.0


def test_more_cameras_than_have_room_are_refused_with_the_most_that_have(endpoint, monkeypatch):
    monkeypatch.setattr(gate, "_SEARCH_S", 60.0)  # However slow this machine is.
    with asking(endpoint, robot_distance_m=0.5) as user:
        # 1.1 m at 20 degrees: 2 * 1.034 * sin(pi / 12) = 0.535 m, and 0.495 m for 13.
        with pytest.raises(CommandFailed, match=r"0\.1.* < 0\.5 m; nearest feasible cameras = 12"):
            user.request("planner", "set", {"cameras": 40}, timeout_s=12 * TIMEOUT_S)
        user.request("planner", "set", {"cameras": 12}, timeout_s=TIMEOUT_S)


def test_a_planner_that_is_told_an_infeasible_formation_does_not_begin(endpoint):
    told = {"path": "circle", "semi_axes_m": (2.0, 2.0), "lap_s": 20.0, "drive": "unicycle"}
    with (
        pytest.raises(InfeasibleError, match="field of view"),
        running(endpoint, **told, radius_m=2),
    ):
        pass
    with running(endpoint, **told, radius_m=2, infeasible="allow"):
        pass


def test_the_formation_tells_whether_it_sees_the_target(user):
    with user.subscribe(FORMATION) as formations:
        user.publish(TARGET_POSE, target(1))
        report = formations.get(TIMEOUT_S).message.feasibility
    assert report.feasible
    assert len(report.robots) == NUM_CAMERAS
    assert report.target_apart_m == pytest.approx(1.1)  # Not only level.
    assert [rule.name for rule in report.rules] == ["field of view"]


def on_a_circle(tick, radius_m=2.0, lap_s=20.0):
    phase = 2 * np.pi * tick * DT_S / lap_s
    place = radius_m * np.sin(phase), radius_m * (1 - np.cos(phase))
    speed = 2 * np.pi * radius_m / lap_s
    ahead = (speed * np.cos(phase), speed * np.sin(phase), 0)
    told = target(tick).model_copy(update={"pose": Pose.from_matrix(planar(*place, phase))})
    twist = Twist(linear=ahead, angular=(0, 0, 2 * np.pi / lap_s))
    return told.model_copy(update={"twist": twist})


def test_a_circle_that_looks_ahead_is_led_to_and_keeps_the_target_in_view(endpoint):
    path = {"path": "circle", "semi_axes_m": (2.0, 2.0), "lap_s": 20.0}
    with asking(endpoint, **path, drive="unicycle", radius_m=0.6, beta_deg=40) as user:
        wish = {"strategy": "adaptive_angles", "radius_m": 0.8, "forecast": "path"}
        told = user.request("planner", "set", wish, timeout_s=TIMEOUT_S)
        assert told["strategy"] == "adaptive_angles"
        with user.subscribe(FORMATION) as formations:
            for tick in range(60):
                user.publish(TARGET_POSE, on_a_circle(tick))
                formation = formations.get(TIMEOUT_S).message
        assert formation.strategy == "adaptive_angles"
        assert formation.radius_m == pytest.approx(0.8)
        assert len(formation.references) == NUM_CAMERAS
        assert formation.feasibility.feasible
