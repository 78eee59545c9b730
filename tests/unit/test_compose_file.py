"""compose.yaml, the Dockerfile and pyproject.toml tell one story, and none of them a loose one."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest
import yaml

from services.launcher.cli import _COMMANDS, _SERVICES
from services.runtime.settings import BusSettings

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parents[2]
COMPOSE = yaml.safe_load((ROOT / "compose.yaml").read_text())
SERVICES = COMPOSE["services"]
LASTING = sorted(set(SERVICES) - {"kernels"})
DOCKERFILE = (ROOT / "docker/Dockerfile").read_text()
STAGES = dict(re.findall(r"^FROM \S+ AS (\S+)\n(.*?)(?=^FROM |\Z)", DOCKERFILE, re.M | re.S))
PARENTS = {name: parent for parent, name in re.findall(r"^FROM (\S+) AS (\S+)$", DOCKERFILE, re.M)}
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]

NUM_CAMERAS = {"hexagon": 6, "triangle": 3}
NEEDED = {  # Extras of pyproject.toml, by service.
    "router": set(),
    "planner": set(),
    "simulator": {"simulator"},
    "camera": {"camera"},
    "mapper": {"queries", "mesh", "color"},
    "evaluator": {"evaluator"},
    "viewer": {"viewer", "simulator"},
    "recorder": {"recorder"},
    "kernels": {"simulator", "camera"},
}


def in_profile(profile):
    """Return what `--profile` starts."""
    return {
        name: each for name, each in SERVICES.items() if profile in each.get("profiles", [profile])
    }


def kind(name):
    """Return which service it is: `camera` of `camera-3`."""
    return SERVICES[name]["image"].removeprefix("encircle-")


def requirements(stage):
    """Return the extras whose requirements an image has, down to the base."""
    extras = set()
    while stage in STAGES:
        for file in re.findall(r"source=/asked/(\w+)\.txt", STAGES[stage]):
            (asked,) = re.findall(rf"requirements\.py ?([a-z ]*) > {file}\.txt", DOCKERFILE)
            extras |= set(asked.split())
        stage = PARENTS[stage]
    return extras


@pytest.mark.parametrize("profile", NUM_CAMERAS)
def test_a_profile_is_a_whole_ring(profile):
    kinds = [kind(name) for name in in_profile(profile)]
    singles = {"router", "kernels", "simulator", "planner", "mapper", "evaluator", "viewer"}
    assert {each for each in kinds if each != "camera"} == singles
    assert sorted(kinds) == sorted([*singles, *["camera"] * NUM_CAMERAS[profile]])


@pytest.mark.parametrize("profile", NUM_CAMERAS)
def test_all_of_a_profile_speak_of_the_same_cameras(profile):
    ring = in_profile(profile)
    cameras = [
        each["environment"]["ENCIRCLE_CAMERA_CAMERA"]
        for name, each in ring.items()
        if kind(name) == "camera"
    ]
    assert cameras == list(range(NUM_CAMERAS[profile]))
    for single in ("simulator", "planner"):
        (environment,) = (
            each["environment"] for name, each in ring.items() if kind(name) == single
        )
        assert environment[f"ENCIRCLE_{single.upper()}_CAMERAS"] == NUM_CAMERAS[profile]


def test_without_a_profile_six_cameras_come_up():
    assert "COMPOSE_PROFILES=hexagon" in (ROOT / ".env").read_text().splitlines()


def test_the_recorder_comes_by_its_profile_alone():
    assert SERVICES["recorder"]["profiles"] == ["record"]


@pytest.mark.parametrize("name", SERVICES)
def test_every_service_is_confined(name):
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["logging"]["options"] == {"max-size": "10m", "max-file": "3"}
    assert not {"privileged", "cap_add", "pid", "user", "devices"} & set(service)
    for port in service.get("ports", ()):
        assert port.startswith("127.0.0.1:")


@pytest.mark.parametrize("name", SERVICES)
def test_no_part_of_the_host_is_mounted(name):
    volumes = {each.partition(":")[0] for each in SERVICES[name].get("volumes", ())}
    assert volumes <= set(COMPOSE["volumes"])


@pytest.mark.parametrize("name", LASTING)
def test_every_service_is_looked_after(name):
    service = SERVICES[name]
    assert service["restart"] == "unless-stopped"
    called = {"camera": name.replace("-", "/")}.get(kind(name), kind(name))
    assert service["healthcheck"]["test"] == ["CMD", "encircle", "health", called]
    if name != "router":
        assert service["depends_on"]["kernels"] == {"condition": "service_completed_successfully"}
        assert {"shm:/dev/shm", "kernels:/var/cache/encircle"} <= set(service["volumes"])


@pytest.mark.parametrize("name", SERVICES)
def test_every_setting_in_the_environment_is_one(name):
    groups = {
        "BUS": BusSettings,
        "SIMULATOR": "simulator.settings:SimulatorSettings",
        "PLANNER": "planner.settings:PlannerSettings",
        "CAMERA": "camera.settings:CameraSettings",
        "VIEWER": "viewer.settings:ViewerSettings",
        "RECORDER": "recorder.settings:RecorderSettings",
        "ROUTER": "runtime.router:RouterSettings",
    }
    for variable in SERVICES[name].get("environment", {}):
        _, group, field = variable.split("_", 2)
        settings = groups[group]
        if isinstance(settings, str):
            module, _, noun = settings.partition(":")
            settings = getattr(importlib.import_module(f"services.{module}"), noun)
        assert field.lower() in settings.model_fields, variable


@pytest.mark.parametrize("stage", NEEDED)
def test_an_image_has_what_its_service_needs_and_no_more(stage):
    assert {kind(name) for name in SERVICES} == set(NEEDED)
    needed = {each for extra in NEEDED[stage] for each in EXTRAS[extra]}
    assert {each for extra in requirements(stage) for each in EXTRAS[extra]} == needed


@pytest.mark.parametrize("stage", sorted(set(NEEDED) - {"kernels"}))
def test_an_image_runs_a_command_as_nobody_from_a_wheel(stage):
    lines = STAGES[stage].split("\n\n")[0].splitlines()
    (said,) = (line for line in lines if line.startswith("CMD"))
    assert re.fullmatch(r'CMD \["(\w+)"\]', said)[1] in {*_COMMANDS, *_SERVICES}
    assert "USER encircle" in lines
    assert lines[0] == "COPY --from=ours /opt/ours /opt/ours"


def test_ours_is_installed_once_and_not_in_place():
    assert DOCKERFILE.count("--target /opt/ours") == 1
    assert "install -e" not in DOCKERFILE
    assert "*.whl" in STAGES["ours"]


def test_the_base_is_pinned_and_the_only_one():
    (base,) = re.findall(r"^ARG PYTHON=(\S+)$", DOCKERFILE, re.M)
    assert re.fullmatch(r"python:3\.\d+-slim-[a-z]+(@sha256:[0-9a-f]{64})?", base)
    assert {parent for parent in PARENTS.values() if parent not in STAGES} == {"${PYTHON}"}


def test_each_image_is_built_by_one_service_that_every_profile_starts_with_the_others():
    builders = [name for name, each in SERVICES.items() if "build" in each]
    targets = [SERVICES[name]["build"]["target"] for name in builders]
    assert [kind(name) for name in builders] == targets
    for name, each in SERVICES.items():
        if "build" not in each:
            assert each["pull_policy"] == "never", name
            (builder,) = [other for other in builders if kind(other) == kind(name)]
            assert "profiles" not in SERVICES[builder], name
