"""The viewer in a real browser, with a real run behind it: what is shown, and what a click does."""

import io
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.topics import MAP_SUMMARY
from services.runtime.bus import Bus
from services.runtime.errors import NoReply
from services.runtime.settings import BusSettings

CHROMIUM = Path("/usr/bin/chromium")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = [
    pytest.mark.e2e,
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is not installed"),
]

PORT, PAGE_PORT = 7472, 8472
URL = f"http://127.0.0.1:{PAGE_PORT}/"
FLAGS = (
    *("run", "--headless", "--forever", "--port", str(PORT), "--viewer-port", str(PAGE_PORT)),
    # Software draws the page on the cores that the run has, too: few instants.
    *("--mode", "realtime", "--rate", "4", "--cameras", "3", "--resolution", "320x240"),
    # Robots with wheels can keep this formation too.
    *("--semi-axes", "4.0", "3.2", "--lap", "60", "--radius", "0.8", "--vfov", "64.4"),
    *("--voxel-size", "0.02", "--deformation", "rigid"),
)
WITHOUT_GPU = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WAIT_S = 60.0
SIZE = {"width": 900, "height": 600}


@dataclass
class Seen:
    """A page, the run behind it, and what went wrong on it."""

    page: Any
    bus: Bus
    outside: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def get(self, service: str) -> dict[str, Any]:
        """Return what a service reports; one that is busy is asked again."""
        return self.bus.request(service, "get", timeout_s=WAIT_S)

    def until(self, service: str, name: str, value: object) -> None:
        """Wait until a service reports a value."""
        wait(lambda: self.get(service)[name] == value, f"{service}: {name} {value!r}")

    def control(self, label: str) -> Any:
        """Return the input with this label, once a service has reported its value."""
        found = self.page.get_by_label(label, exact=True)
        playwright.expect(found).to_be_enabled(timeout=WAIT_S * 1e3)
        return found

    def press(self, label: str) -> None:
        self.page.get_by_role("button", name=label, exact=True).click()

    def write(self, label: str, value: str) -> None:
        self.control(label).fill(value)
        self.control(label).press("Tab")

    def choose(self, label: str, value: str) -> None:
        self.control(label).click()
        self.page.get_by_role("option", name=value, exact=True).click()

    def picture(self) -> NDArray[np.uint8]:
        """Return the (H, W, 3) picture of the window."""
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB"))

    def scene(self) -> NDArray[np.uint8]:
        """Return the (H, W, 3) picture of the part left of the panel."""
        return self.picture()[:, : SIZE["width"] - 420]


def wait(reached: Callable[[], bool], what: str) -> None:
    """Wait for what other processes do; there is no queue to wait on."""
    deadline_s = time.monotonic() + WAIT_S
    while not reached():
        assert time.monotonic() < deadline_s, f"not within {WAIT_S} s: {what}"
        time.sleep(0.1)


@pytest.fixture(scope="module")
def run_of_three(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bus]:
    """A run with its viewer; yields a bus to ask it by."""
    process = subprocess.Popen(
        [sys.executable, "-c", "from services.launcher.cli import main; main()", *FLAGS],
        cwd=tmp_path_factory.mktemp("run"),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        with Bus(BusSettings(connect=f"tcp/127.0.0.1:{PORT}", shm_pool_mib=0), "user") as bus:
            with bus.latest(MAP_SUMMARY) as summaries:
                summaries.get(2 * WAIT_S)
            bus.request("viewer", "get", timeout_s=WAIT_S)
            yield bus
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, output
    assert f"see it at http://localhost:{PAGE_PORT}" in output


@pytest.fixture(scope="module")
def seen(run_of_three: Bus) -> Iterator[Seen]:
    """The page in a browser."""
    with ExitStack() as stack:
        driver = stack.enter_context(playwright.sync_playwright())
        browser = driver.chromium.launch(
            executable_path=str(CHROMIUM), args=[*WITHOUT_GPU, "--no-sandbox"]
        )
        stack.callback(browser.close)
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(WAIT_S * 1e3)
        seen = Seen(page, run_of_three)
        page.on("request", lambda request: _note_outside(seen, request.url))
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.on("console", lambda line: _note_error(seen, line))
        page.goto(URL)
        wait(lambda: seen.get("viewer")["frames"] > 3, "the first frames")
        seen.control("Cameras")
        yield seen
        assert seen.outside == []
        assert seen.errors == []


def _note_outside(seen: Seen, url: str) -> None:
    if not url.startswith((URL, "data:", "blob:")):
        seen.outside.append(url)


def _note_error(seen: Seen, line: Any) -> None:
    if line.type == "error":
        seen.errors.append(line.text)


@pytest.fixture(autouse=True)
def _asks_are_answered(seen: Seen) -> Iterator[None]:
    """Leave no request of one test to the next."""
    yield
    try:
        seen.get("viewer")
    except NoReply:
        pytest.fail("the viewer does not answer any more")


def saturated(picture: NDArray[np.uint8]) -> int:
    """Return how many pixels have a colour of their own."""
    spread = picture.max(axis=2).astype(int) - picture.min(axis=2)
    return int(np.count_nonzero(spread > 80))


def test_the_scene_is_drawn_and_nothing_comes_from_outside(seen: Seen) -> None:
    assert seen.get("viewer")["voxels_drawn"] > 500
    wait(lambda: saturated(seen.scene()) > 1500, "a coloured map, frusta and a polygon")
    assert seen.outside == []


def test_pause_step_and_resume(seen: Seen) -> None:
    seen.press("Pause")
    seen.until("simulator", "state", "paused")
    tick = seen.get("simulator")["tick"]
    seen.press("Step")
    seen.until("simulator", "tick", tick + 1)
    assert seen.get("simulator")["state"] == "paused"
    seen.page.get_by_text("paused").first.wait_for()
    seen.press("Resume")
    wait(lambda: seen.get("simulator")["tick"] > tick + 1, "the next ticks")


@pytest.mark.parametrize(
    ("label", "text", "service", "name", "value"),
    [
        ("Radius (m)", "0.9", "planner", "radius_m", 0.9),
        ("Elevation (deg)", "30", "planner", "elevation_deg", 30.0),
    ],
)
def test_a_number_that_is_written_is_asked_for(
    seen: Seen, label: str, text: str, service: str, name: str, value: float
) -> None:
    seen.write(label, text)
    seen.until(service, name, value)


@pytest.mark.parametrize(
    ("label", "choice", "service", "name"),
    [
        ("Strategy", "rings", "planner", "strategy"),
        ("Strategy", "circle", "planner", "strategy"),
        ("Drive", "unicycle", "planner", "drive"),
        ("Drive", "flying", "planner", "drive"),
        ("Object", "torus", "simulator", "object"),
        ("Deformation", "twist", "simulator", "deformation"),
        ("Map memory", "persistent", "mapper", "memory"),
    ],
)
def test_what_is_chosen_is_asked_for(
    seen: Seen, label: str, choice: str, service: str, name: str
) -> None:
    seen.choose(label, choice)
    seen.until(service, name, choice)


def test_another_number_of_cameras_starts_their_processes_and_shows_their_images(
    seen: Seen,
) -> None:
    seen.write("Cameras", "4")
    seen.until("launcher", "running", [0, 1, 2, 3])
    with seen.bus.latest(MAP_SUMMARY) as summaries:
        wait(lambda: len(summaries.get(WAIT_S).message.cameras_used) == 4, "four clouds")
    seen.page.get_by_text("Camera 3", exact=True).first.wait_for(state="attached")
    seen.write("Cameras", "2")
    seen.until("launcher", "running", [0, 1])
    seen.until("simulator", "cameras", [0, 1])


def test_what_is_refused_is_shown_in_the_services_own_words(seen: Seen) -> None:
    before = seen.get("planner")["elevation_deg"]
    seen.write("Elevation (deg)", "-80")
    seen.page.get_by_text("below the ground").first.wait_for()
    assert seen.get("planner")["elevation_deg"] == before
    # The panel shows what is, not what was written.
    shown = f"{before:g}"
    wait(lambda: seen.control("Elevation (deg)").input_value() == shown, "the old value")


@pytest.mark.parametrize("by", ["probability", "age", "height"])
def test_voxels_are_coloured_by_what_is_chosen(seen: Seen, by: str) -> None:
    seen.choose("Colour by", by)
    seen.until("viewer", "colour_by", by)
    wait(lambda: saturated(seen.scene()) > 1000, "coloured voxels")


def test_plots_move(seen: Seen) -> None:
    plot = seen.page.locator("canvas").nth(2)
    before = plot.screenshot()
    wait(lambda: plot.screenshot() != before, "a longer curve")


def test_reset_begins_anew(seen: Seen) -> None:
    tick = seen.get("simulator")["tick"]
    seen.press("Reset")
    wait(lambda: 0 < seen.get("simulator")["tick"] < tick, "a new run")


def test_dark_is_dark_and_light_is_light(seen: Seen) -> None:
    assert np.median(seen.picture()) > 200
    seen.control("Dark").check()
    wait(lambda: np.median(seen.picture()) < 80, "a dark page")
    assert saturated(seen.scene()) > 1000
    seen.control("Dark").uncheck()
    wait(lambda: np.median(seen.picture()) > 200, "a light page")
