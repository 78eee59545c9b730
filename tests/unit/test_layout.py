"""The rules of the house that no linter knows."""

import ast
import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest

import schemas
import services

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parents[2]
SOURCES = sorted([*(ROOT / "schemas").rglob("*.py"), *(ROOT / "services").rglob("*.py")])
SERVICES = ("planner", "camera", "simulator", "mapper", "evaluator", "viewer")
MAX_LINES = 250


def imports_of(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_the_imported_packages_are_ours() -> None:
    for package in (schemas, services):
        assert Path(package.__file__).resolve().is_relative_to(ROOT)
    assert importlib.metadata.metadata("encircle")["Name"] == "encircle"


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_a_module_is_one_noun_of_at_most_250_lines(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= MAX_LINES
    assert path.stem not in {"utils", "helpers", "misc", "common"}


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_packages_re_export_nothing(path: Path) -> None:
    if path.name == "__init__.py":
        assert not imports_of(path)


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_only_the_runtime_speaks_zenoh(path: Path) -> None:
    if not relative(path).startswith("services/runtime/"):
        assert "zenoh" not in {name.split(".")[0] for name in imports_of(path)}


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_only_settings_read_the_environment(path: Path) -> None:
    if relative(path).startswith("services/launcher/"):
        return  # It hands the environment on to the processes it starts.
    assert not re.search(r"os\.environ|os\.getenv", path.read_text())


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_the_core_never_sees_the_bus(path: Path) -> None:
    service, _, module = relative(path).removeprefix("services/").partition("/")
    shells = {"service.py", "__main__.py", "settings.py"}
    if service not in SERVICES or module in shells or module.endswith("_service.py"):
        return
    bus = {"services.runtime.bus", "services.runtime.loop", "services.runtime.reader"}
    assert not imports_of(path) & bus


@pytest.mark.parametrize("service", SERVICES)
def test_every_service_has_the_same_rooms(service: str) -> None:
    folder = ROOT / "services" / service
    for name in ("__main__.py", "settings.py", "service.py"):
        assert (folder / name).exists(), f"services/{service}/{name} is missing"
    lines = (folder / "__main__.py").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) <= 8


def test_heavy_packages_are_only_in_the_extra_of_their_service() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    core = {re.split(r"[<>=\[]", name)[0] for name in project["dependencies"]}
    heavy = {"open3d", "pybullet", "viser", "matplotlib", "opencv-python-headless", "scipy"}
    assert not core & heavy


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_heavy_packages_are_imported_when_needed_and_not_at_import(path: Path) -> None:
    top = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Import):
            top |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            top.add(node.module.split(".")[0])
    assert not top & {"open3d", "pybullet", "cv2", "matplotlib", "trimesh"}


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_comments_are_no_to_do_lists(path: Path) -> None:
    assert not re.search(r"#.*\b(TODO|FIXME|XXX|HACK)\b", path.read_text())
