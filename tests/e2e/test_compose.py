"""`docker compose up` as its users run it: the ring of six in containers, heard from the host.

The tests share one ring, in the order in which they stand; each leaves it whole for the next.
"""

import json
import os
import resource
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest

from schemas.topics import MAP_SUMMARY, QUALITY, SERVICE_STATUS
from services.launcher.ports import free_port
from services.recorder.log_file import RecordedLog
from services.runtime.bus import Bus
from services.runtime.settings import BusSettings

# The first build downloads a gigabyte.
pytestmark = [pytest.mark.docker, pytest.mark.timeout(1500)]

ROOT = Path(__file__).parents[2]
PROJECT = "encircle-test"
CAMERAS = set(range(6))
BUILD_S, UP_S, WAIT_S = 1200, 240, 180

# Where the engine may not lift the limit on locked memory, 8 MiB as a rule, the mapper can lock the
# pools of three cameras (1 MiB and 1.25 MiB of zenoh's books each), if they are small.
_FEW_SHARE = {0, 1, 3}
_SMALL_IMAGES = {"ENCIRCLE_CAMERA_WIDTH": "320", "ENCIRCLE_CAMERA_HEIGHT": "240"}
_POOL = "ENCIRCLE_BUS_SHM_POOL_MIB"


class Ring:
    """A compose project of its own, on ports of its own."""

    def __init__(self, folder: Path) -> None:
        self.port, self.viewer_port = free_port(), free_port()
        self.environment = os.environ | {
            "ENCIRCLE_PORT": str(self.port),
            "ENCIRCLE_VIEWER_PORT": str(self.viewer_port),
        }
        self.sharing = CAMERAS
        self._files = ["--file", "compose.yaml"]
        self._folder = folder

    def spare_memory(self) -> None:
        """Make do with what may be locked here, if the engine may not lift the limit."""
        refused = subprocess.run(
            ["docker", "run", "--rm", "--ulimit", "memlock=-1", "encircle-router", "--version"],
            capture_output=True,
            timeout=120,
            check=False,
        ).returncode
        if not refused:
            return
        self.sharing = _FEW_SHARE
        self.environment |= {
            "ENCIRCLE_MEMLOCK": str(resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]),
            "ENCIRCLE_SHM_POOL_MIB": "0",
        }
        services = {
            f"camera-{camera}": {
                "environment": _SMALL_IMAGES | {_POOL: str(int(camera in self.sharing))}
            }
            for camera in CAMERAS
        }
        file = self._folder / "spare.yaml"
        file.write_text(json.dumps({"services": services}))  # Which is YAML, too.
        self._files += ["--file", str(file)]

    def compose(self, *args: str, timeout_s: float = 120, check: bool = True) -> str:
        profiles = ("--profile", "hexagon", "--profile", "record")
        done = subprocess.run(
            ["docker", "compose", *self._files, "--project-name", PROJECT, *profiles, *args],
            cwd=ROOT,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        assert done.returncode == 0 or not check, f"{args}: {done.stdout}{done.stderr}"
        return done.stdout

    def build(self) -> None:
        """Build one image after the other: small machines, old engines."""
        services = json.loads(self.compose("config", "--format", "json"))["services"]
        for name in [name for name, each in services.items() if "build" in each]:
            self.compose("build", name, timeout_s=BUILD_S)

    def containers(self) -> dict[str, dict]:
        """Return what the engine knows of each service's container."""
        ids = self.compose("ps", "--all", "--quiet").split()
        told = subprocess.run(
            ["docker", "inspect", *ids], capture_output=True, text=True, timeout=60, check=True
        )
        service = "com.docker.compose.service"
        return {each["Config"]["Labels"][service]: each for each in json.loads(told.stdout)}

    def story(self) -> str:
        """Return what is to be read when something does not come about."""
        return self.compose("ps", "--all", check=False) + self.compose(
            "logs", "--tail", "8", check=False
        )

    def wait_for(self, topic, holds):
        """Wait for a message that holds, heard by a session of its own on the host."""
        with self.bus() as bus, bus.subscribe(topic) as messages:
            deadline_s = time.monotonic() + WAIT_S
            last = None
            while (left_s := deadline_s - time.monotonic()) > 0:
                try:
                    last = messages.get(left_s)
                except TimeoutError:
                    break
                if holds(last.message):
                    return last.message
        raise AssertionError(f"not heard within {WAIT_S} s; last {last}\n{self.story()}")

    def bus(self) -> Bus:
        return Bus(BusSettings(connect=f"tcp/127.0.0.1:{self.port}"), "inspector")


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    if shutil.which("docker") is None:
        pytest.skip("no docker on this machine")
    asked = ("docker", "info", "--format", "{{.ServerVersion}}")
    if subprocess.run(asked, capture_output=True, timeout=30, check=False).returncode:
        pytest.skip("no Docker engine answers")
    ring = Ring(tmp_path_factory.mktemp("ring"))
    try:
        ring.build()
        ring.spare_memory()
        ring.compose("up", "--detach", timeout_s=UP_S)
        yield ring
    finally:
        ring.compose("down", "--volumes", "--remove-orphans", "--timeout", "10", check=False)


def seen(quality) -> bool:
    """Most of what the cameras see is in the map, and little else."""
    score = quality.stamp_true[1]
    return score.coverage_visible > 0.7 and score.precision > 0.9


def test_coverage_is_heard_on_the_host(ring):
    ring.wait_for(QUALITY, seen)


def test_all_six_cameras_make_one_map(ring):
    ring.wait_for(MAP_SUMMARY, lambda summary: set(summary.cameras_used) == CAMERAS)


def test_clouds_go_from_container_to_container_by_shared_memory(ring):
    def heard(status):
        return {
            int(topic.key.split("/")[1]): topic
            for topic in status.topics
            if topic.key.endswith("/cloud") and not topic.sent and topic.count
        }

    def whole(status):
        return status.service == "mapper" and set(heard(status)) == CAMERAS

    for camera, cloud in heard(ring.wait_for(SERVICE_STATUS, whole)).items():
        if camera in ring.sharing:
            # The first may come by the router, before the two have met.
            assert cloud.shared_memory >= cloud.count - 3, camera
    for camera in ring.sharing:

        def of_camera(status, camera=camera):
            return (status.service, status.instance) == ("camera", str(camera))

        assert ring.wait_for(SERVICE_STATUS, of_camera).shm_used, camera


def test_the_page_is_served(ring):
    with urllib.request.urlopen(f"http://127.0.0.1:{ring.viewer_port}/", timeout=60) as page:
        assert page.status == 200
        assert b"<html" in page.read()


def test_every_container_is_confined(ring):
    for name, told in ring.containers().items():
        host = told["HostConfig"]
        assert told["Config"]["User"] == "encircle", name
        assert host["ReadonlyRootfs"], name
        assert host["CapDrop"] == ["ALL"], name
        assert not host["Privileged"], name
        for port, bound in (host["PortBindings"] or {}).items():
            assert {each["HostIp"] for each in bound} == {"127.0.0.1"}, (name, port)
    who = ring.compose("exec", "-T", "mapper", "sh", "-c", "id -u; touch /opt/ours/x || echo no")
    assert who.split() == ["10001", "no"]


def test_the_kernels_come_compiled(ring):
    """Asked for once more, after all have started, all is there: nobody compiled his own."""
    new = 'find "$NUMBA_CACHE_DIR" -name "*.nbi" -newer /proc/1 | wc -l'
    said = ring.compose(
        "run", "--rm", "-T", "--entrypoint", "sh", "kernels", "-c", f"encircle compile && {new}"
    ).split("\n")
    assert said[-3:] == ["the kernels are compiled", "0", ""]


def test_a_camera_that_is_stopped_is_done_without_and_taken_up_again(ring):
    ring.compose("stop", "--timeout", "10", "camera-2")
    others = ring.wait_for(MAP_SUMMARY, lambda summary: set(summary.cameras_used) == CAMERAS - {2})
    scored = ring.wait_for(QUALITY, lambda quality: quality.rev > others.rev)
    assert scored.num_voxels > 0
    ring.wait_for(QUALITY, seen)

    ring.compose("start", "camera-2")
    ring.wait_for(MAP_SUMMARY, lambda summary: set(summary.cameras_used) == CAMERAS)


def test_a_mapper_that_dies_is_started_again(ring):
    before = ring.containers()["mapper"]["RestartCount"]
    ring.compose("exec", "-T", "mapper", "sh", "-c", "kill -KILL -1", check=False)
    ring.wait_for(
        SERVICE_STATUS, lambda status: status.service == "mapper" and status.uptime_s < 20
    )
    assert ring.containers()["mapper"]["RestartCount"] == before + 1
    ring.wait_for(QUALITY, seen)


def test_all_are_healthy(ring):
    deadline_s = time.monotonic() + WAIT_S
    health: dict[str, str] = {}
    while time.monotonic() < deadline_s:
        states = {name: told["State"] for name, told in ring.containers().items()}
        assert states.pop("kernels")["ExitCode"] == 0
        health = {name: state["Health"]["Status"] for name, state in states.items()}
        if set(health.values()) == {"healthy"}:
            return
        time.sleep(1)
    raise AssertionError(f"{health}\n{ring.story()}")


def test_what_was_recorded_can_be_taken_out_and_read(ring, tmp_path):
    ring.compose("stop", "--timeout", "20", "recorder")
    ring.compose("cp", "recorder:/data/recording.mcap", str(tmp_path))
    log = RecordedLog(tmp_path / "recording.mcap")
    keys = {record.key for record in log}
    assert keys >= {"metrics/quality", *(f"cams/{camera}/cloud" for camera in CAMERAS)}


def test_nothing_is_left_when_it_comes_down(ring):
    ring.compose("down", "--volumes", "--timeout", "10")
    ours = f"label=com.docker.compose.project={PROJECT}"
    for what in (("ps", "--all"), ("volume", "ls"), ("network", "ls")):
        left = subprocess.run(
            ["docker", *what, "--quiet", "--filter", ours],
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
        assert left.stdout == "", what
