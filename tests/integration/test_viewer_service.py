"""The viewer on a real bus, and browsers that speak viser's wire format: what they are told."""

import socket
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from schemas.camera import CameraInfo, CameraPose, Intrinsics
from schemas.cloud import DepthCloud
from schemas.geometry import Pose, Twist
from schemas.map import OCCUPIED, MapChanges, MapFull
from schemas.target import TargetPose
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_INFO,
    CAMERA_POSE,
    MAP_CHANGES,
    MAP_FULL,
    TARGET_POSE,
)
from services.kernels.rigid import look_at, planar
from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.runtime.loop import Loop
from services.viewer.service import ViewerService
from services.viewer.settings import ViewerSettings
from tests.integration.conftest import running
from tests.integration.viewer_browser import TIMEOUT_S, browsing, stalled

pytestmark = pytest.mark.integration

STAMP = {"t_ns": 0, "tick": 0, "frame_id": "world"}
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
SIZE_M = 0.02
OPTICS = Intrinsics.from_vertical_fov(64, 48, 0.8)
POSE = Pose.from_matrix(planar(0.5, -0.5, 0.3))


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def start(open_bus):
    """Start a viewer, draw fast, and return its port."""

    @contextmanager
    def begin(**settings):
        bus = open_bus("viewer")
        loop = Loop(bus)
        made = ViewerSettings(**{"port": free_port(), "rate_hz": 30.0, **settings})
        service = ViewerService(made, bus, loop)
        with running(loop):
            yield service.web.port

    return begin


@pytest.fixture
def planner(open_bus):
    bus = open_bus("planner")
    loop = Loop(bus)
    service = PlannerService(PlannerSettings(), bus, loop)
    with running(loop):
        yield service


def eventually(happens):
    """Ask again until it is so."""
    deadline_s, pause = time.monotonic() + TIMEOUT_S, threading.Event()
    while not (answer := happens()):
        assert time.monotonic() < deadline_s
        pause.wait(0.02)
    return answer


def changes(voxels, rev=1):
    rows = np.column_stack([voxels, np.full(len(voxels), OCCUPIED)]).astype(np.int16)
    return MapChanges.of(
        rows, t_ns=rev, tick=rev, frame_id="target", rev=rev, base_rev=0, resolution_m=SIZE_M,
        origin=(-0.5, -0.5, 0.0), shape_voxels=(80, 80, 80), pose=POSE,
    )  # fmt: skip


def cube(side, num):
    cells = np.random.default_rng(num).choice(side**3, num, replace=False)
    return np.stack(np.unravel_index(cells, (side,) * 3), axis=1)


def told_of(name, *properties):
    """Match what sets a scene node's properties, when it is made or later."""

    def wanted(message):
        if message.get("name") != name:
            return None
        values = {**message.get("props", {}), **message.get("updates", {})}
        return {key: values[key] for key in properties if key in values} or None

    return wanted


def status(text):
    """Match the panel's text."""

    def wanted(message):
        said = {**message.get("props", {}), **message.get("updates", {})}.get("_markdown", "")
        return said if text in said else None

    return wanted


def test_an_empty_bus_is_named_with_the_command_that_mends_it(start):
    with start() as port, browsing(port) as browser:
        said = browser.until(status("Nobody is on the bus"))
        assert "`encircle run`" in said


def test_a_map_on_the_bus_becomes_points_in_the_browser(start, open_bus):
    mapper = open_bus("mapper", announce=True)
    voxels = cube(80, 1000)
    with start() as port, browsing(port) as browser:
        eventually(lambda: mapper.matching(MAP_CHANGES))
        mapper.publish(MAP_CHANGES, changes(voxels))
        found = browser.until(told_of("/world/voxels", "points"))["points"].reshape(-1, 3)
        expected = (voxels + 0.5) * SIZE_M
        order = [np.lexsort(np.floor(points / SIZE_M).T) for points in (expected, found)]
        np.testing.assert_allclose(found[order[1]], expected[order[0]], atol=1e-5)
        # Of the next map only what differs is said: the handle stays.
        mapper.publish(MAP_CHANGES, changes(voxels[:500], rev=2))
        fewer = browser.until(
            lambda message: (
                message["type"] == "SceneNodeUpdateMessage"
                and told_of("/world/voxels", "points")(message)
            )
        )
        assert len(fewer["points"]) == 3 * 500


def test_no_more_is_drawn_than_allowed_and_the_true_count_is_told(start, open_bus):
    mapper = open_bus("mapper", announce=True)
    with start(max_points=300) as port, browsing(port) as browser:
        eventually(lambda: mapper.matching(MAP_CHANGES))
        mapper.publish(MAP_CHANGES, changes(cube(80, 4321)))
        assert len(browser.until(told_of("/world/voxels", "points"))["points"]) == 3 * 300
        assert "4,321 voxels, 300 drawn" in browser.until(status("voxels"))


def test_a_camera_is_shown_with_its_depths_and_goes_when_it_goes(start, open_bus):
    camera = open_bus("camera", "2", announce=True)
    pose = Pose.from_matrix(look_at((1.0, 0.2, 0.5), (0, 0, 0.2)))
    who = {**STAMP, "camera": 2}
    info = CameraInfo(
        **who, intrinsics=OPTICS, depth_scale_m=0.001, min_range_m=0.1, max_range_m=5.0,
        noise="ideal",
    )  # fmt: skip
    cloud = DepthCloud.of(
        np.full((48, 64), 900, np.uint16), **who, pose=pose, max_range_m=5.0, t_capture_ns=0,
        intrinsics=OPTICS, depth_scale_m=0.001,
    )  # fmt: skip
    with start() as port, browsing(port) as browser:
        eventually(lambda: camera.matching(CAMERA_CLOUD, 2) and camera.matching(CAMERA_INFO, 2))
        eventually(lambda: camera.matching(CAMERA_POSE, 2))
        camera.publish(CAMERA_INFO, info, camera=2)
        camera.publish(CAMERA_CLOUD, cloud, camera=2)
        camera.publish(CAMERA_POSE, CameraPose(**who, pose=pose, twist=STILL), camera=2)
        assert browser.until(told_of("/world/cameras/2", "aspect"))["aspect"] == 64 / 48
        position = browser.until(told_of("/world/cameras/2", "_image_data"))
        assert bytes(position["_image_data"])[:2] == b"\xff\xd8"  # A JPEG.
        camera.close()
        assert browser.until(
            lambda message: (
                message.get("name") == "/world/cameras/2" and message.get("visible") is False
            )
        )


def test_while_nobody_looks_nothing_large_is_listened_to(start, open_bus):
    camera = open_bus("camera", "0")
    with start() as port:
        with browsing(port):
            eventually(lambda: camera.matching(CAMERA_CLOUD, 0))
        eventually(lambda: not camera.matching(CAMERA_CLOUD, 0))
        with browsing(port):
            eventually(lambda: camera.matching(CAMERA_CLOUD, 0))


def test_a_control_becomes_a_request_and_shows_what_is_reported(start, planner, open_bus):
    asker = open_bus("launcher")
    with start() as port, browsing(port) as browser, browsing(port) as other:
        for each in (browser, other):
            each.until(lambda message: message.get("updates", {}).get("value") == 1.1)
        browser.set("Radius (m)", 1.55)
        eventually(lambda: asker.request("planner", "get")["radius_m"] == 1.55)
        # Whoever else looks sees it too.
        other.until(lambda message: message.get("updates", {}).get("value") == 1.55)
    assert planner is not None


def test_a_refusal_is_shown_with_the_services_own_words_and_the_control_goes_back(start, planner):
    with start() as port, browsing(port) as browser:
        browser.until(lambda message: message.get("updates", {}).get("value") == 20.0)
        browser.set("Elevation (deg)", -80.0)
        told = browser.until(
            lambda message: message["type"] == "NotificationShowMessage" and message["props"]
        )
        assert told["title"] == "planner refused"
        assert "below the ground" in told["body"]
        uuid = browser.controls["Elevation (deg)"]
        browser.until(
            lambda message: (
                message.get("uuid") == uuid and message.get("updates", {}).get("value") == 20.0
            )
        )
    assert planner is not None


def test_a_service_that_is_not_there_is_named_by_its_command(start):
    with start() as port, browsing(port) as browser:
        clock = browser.until(
            lambda message: message["type"] == "GuiButtonGroupMessage" and message["uuid"]
        )
        assert clock == browser.controls["Clock"]
        browser.set("Clock", "Pause")
        told = browser.until(
            lambda message: message["type"] == "NotificationShowMessage" and message["props"]
        )
        assert "encircle simulator" in told["body"]


def test_a_browser_that_stops_reading_costs_neither_frames_nor_memory(start, open_bus):
    mapper = open_bus("mapper", announce=True)
    asker = open_bus("launcher")
    voxels = cube(80, 50_000)
    with start(rate_hz=30.0) as port, stalled(port), browsing(port) as reader:
        eventually(lambda: asker.request("viewer", "get")["browsers"] == 2)
        eventually(lambda: mapper.matching(MAP_CHANGES))
        resident = []
        for rev in range(1, 101):
            mapper.publish(MAP_CHANGES, changes(voxels[rev:], rev))
            # 0.7 MB a frame: the one who reads gets every one, the other's would be 70 MB.
            reader.until(told_of("/world/voxels", "points"))
            resident.append(_resident_bytes())
        frames = asker.request("viewer", "get")["frames"]
        assert frames >= 50
        assert resident[-1] - resident[30] < 25e6


def _resident_bytes():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def test_a_taken_port_gives_way_to_the_next_and_only_the_loopback_is_served(start):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        asked = taken.getsockname()[1]
        with start(port=asked) as port:
            assert port > asked
            with browsing(port):
                pass
            with socket.socket() as outside:  # Another address of this very machine.
                assert outside.connect_ex(("127.0.0.2", port)) != 0


def test_nothing_is_shared_with_the_world(start, caplog):
    with start() as port, browsing(port) as browser:
        theme = browser.until(
            lambda message: message["type"] == "ThemeConfigurationMessage" and message
        )
        assert theme["show_share_button"] is False
        browser.ask_to_share()
        eventually(lambda: "outside relay" in caplog.text)


def test_the_target_leaves_a_path_and_stays_in_the_middle(start, open_bus):
    simulator = open_bus("simulator", announce=True)
    with start() as port, browsing(port) as browser:
        eventually(lambda: simulator.matching(TARGET_POSE))
        for tick in range(2):
            pose = Pose.from_matrix(planar(0.4 * tick, 0.1, 0.0))
            stamp = {"t_ns": tick * 10**8, "tick": tick, "frame_id": "world"}
            simulator.publish(TARGET_POSE, TargetPose(**stamp, pose=pose, twist=STILL))
            if tick == 0:
                browser.until(told_of("/world/target", "axes_length"))
        # The ground goes back as the target goes on.
        moved = browser.until(
            lambda message: (
                message["type"] == "SetPositionMessage"
                and message["name"] == "/world"
                and message["position"][0] < -0.3
                and message["position"]
            )
        )
        assert moved == pytest.approx([-0.4, -0.1, 0.0])
        path = browser.until(told_of("/world/path", "points"))["points"].reshape(-1, 2, 3)
        assert path[0, 1, 0] == pytest.approx(0.4)


def refusal(message):
    """Match a notification."""
    return message["type"] == "NotificationShowMessage" and message["props"]


def test_what_no_page_would_send_changes_nothing(start, planner, open_bus):
    asker = open_bus("launcher")
    with start() as port, browsing(port) as browser:
        browser.until(lambda message: message.get("updates", {}).get("value") == 1.1)
        browser.set("Colour by", "nonsense")
        browser.set("Cameras", 1e30)
        told = browser.until(refusal)
        assert told["body"] == "Cameras must be 1..64, got 1000000000000000019884624838656"
        before = asker.request("viewer", "get")
        assert before["colour_by"] == "height"
        eventually(lambda: asker.request("viewer", "get")["frames"] > before["frames"])
        browser.set("Radius (m)", 1.45)
        eventually(lambda: asker.request("planner", "get")["radius_m"] == 1.45)
    assert planner is not None


def test_clicks_arrive_as_they_were_clicked(start, open_bus):
    done, go_on = [], threading.Event()
    loop = Loop(open_bus("simulator"))

    def carry_out(verb):
        def handle(_):
            done.append(verb)
            assert go_on.wait(TIMEOUT_S)
            return {}

        return handle

    loop.serve("get", lambda _: {})
    for verb in ("pause", "resume", "step"):
        loop.serve(verb, carry_out(verb))
    asker = open_bus("launcher")
    clicks = ["Pause", "Step", "Step", "Step", "Resume", "Pause"]
    with running(loop), start() as port, browsing(port) as browser:
        browser.until(lambda message: message["type"] == "GuiButtonGroupMessage")
        eventually(lambda: "simulator" in asker.request("viewer", "get")["reports"])
        for click in clicks:
            browser.set("Clock", click)
        eventually(lambda: done)
        before = asker.request("viewer", "get")["frames"]
        eventually(lambda: asker.request("viewer", "get")["frames"] > before + 5)
        go_on.set()
        eventually(lambda: len(done) == len(clicks))
        assert done == [click.lower() for click in clicks]


def test_a_service_that_reports_rubbish_does_not_end_the_page(start, open_bus):
    loop = Loop(open_bus("replay"))
    rubbish = {"duration_s": None, "position_s": "late", "rate": [], "state": 7}
    loop.serve("get", lambda _: rubbish)
    asker = open_bus("launcher")
    with running(loop), start() as port, browsing(port) as browser:
        assert "0.0 of 0.1 s" in browser.until(status(" of "))
        before = asker.request("viewer", "get")["frames"]
        eventually(lambda: asker.request("viewer", "get")["frames"] > before + 3)


def test_a_map_beyond_the_bounds_of_a_pose_is_drawn_there(start, open_bus):
    mapper = open_bus("mapper", announce=True)
    far = Pose(position=(9e5, 9e5, 9e5), orientation=(0.0, 0.0, 0.0, 1.0))
    made = changes(cube(80, 10)).model_copy(update={"pose": far, "origin": (9e5, 9e5, 9e5)})
    asker = open_bus("launcher")
    with start() as port, browsing(port) as browser:
        eventually(lambda: mapper.matching(MAP_CHANGES))
        mapper.publish(MAP_CHANGES, made)
        browser.until(told_of("/world/voxels", "points"))
        assert asker.request("viewer", "get")["frames_failed"] == 0


def test_what_troubles_the_launcher_is_told(start, open_bus):
    loop = Loop(open_bus("launcher"))
    loop.serve("get", lambda _: {"cameras": 3, "trouble": "8 cameras are not to be had: no room"})
    with running(loop), start() as port, browsing(port) as browser:
        assert "no room" in browser.until(status("8 cameras are not to be had"))


def test_a_page_that_is_opened_while_nothing_changes_has_the_map(start, open_bus):
    loop = Loop(open_bus("mapper"))
    row = np.full((1, 3 + 8**3), -32768, np.int16)
    row[0, :3], row[0, 3:10] = 0, 8192
    known = changes(cube(80, 1))
    full = MapFull.of(
        row, t_ns=1, tick=1, frame_id="target", rev=1, resolution_m=SIZE_M, origin=known.origin,
        shape_voxels=known.shape_voxels, pose=POSE,
    )  # fmt: skip
    stop = loop.bus.serve(MAP_FULL.key, lambda query: loop.bus.answer(MAP_FULL, query, full))
    with running(loop), start() as port:
        for _ in range(2):
            with browsing(port) as browser:
                assert len(browser.until(told_of("/world/voxels", "points"))["points"]) == 3 * 7
    stop()
