"""What the map is worth, on the scenario that users compare: the promise of the README, in full."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(300)]

ROOT = Path(__file__).parents[2]


def run(folder: Path, scenario: str, *flags: str) -> dict:
    """Run a scenario in its real processes and return its report."""
    report = folder / "report.json"
    command = [sys.executable, "-c", "from services.launcher.cli import main; main()", "run"]
    command += ["--headless", "--scenario", str(ROOT / "scenarios" / f"{scenario}.toml")]
    command += ["--report", str(report), "--runs", str(folder), *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(report.read_text())


@pytest.mark.parametrize(
    ("scenario", "flags"),
    [
        ("hexagon", ("--path", "static")),
        ("hexagon", ()),
        ("deforming", ()),
        ("hexagon", ("--deformation", "squash+twist", "--noise", "d4xx")),
    ],
    ids=["static", "moving", "deforming", "twisting under stereo noise"],
)
def test_a_hexagon_sees_all_that_can_be_seen_and_nothing_that_is_not(
    tmp_path: Path, scenario: str, flags: tuple[str, ...]
) -> None:
    report = run(tmp_path, scenario, "--duration", "4", *flags)
    assert report["tolerance_m"] == 2 * report["voxel_size_m"] == 0.02
    assert report["instants_scored"] == report["perceptions"] == report["ticks"] == 60
    assert report["precision"]["mean"] >= 0.97
    assert report["ghost_rate"]["max"] <= 0.03
    assert report["coverage_visible"]["mean"] >= 0.98
    assert report["coverage_observable"]["mean"] >= 0.95


def test_one_camera_that_flies_through_a_dome_ends_with_what_a_ring_sees_at_once(
    tmp_path: Path,
) -> None:
    report = run(tmp_path, "single_camera", "--duration", "20")
    assert report["cameras"] == 1
    assert report["coverage_observable"]["final"] >= 0.95
    assert report["coverage_observable"]["min"] < 0.7


@pytest.mark.parametrize("cameras", [1, 24])
def test_any_number_of_cameras_takes_part_in_every_instant(tmp_path: Path, cameras: int) -> None:
    flags = ("--cameras", str(cameras), "--resolution", "320x240", "--duration", "2")
    report = run(tmp_path, "hexagon", *flags)
    assert report["perceptions"] == report["ticks"] == 30
    assert report["missed_clouds"] == report["bad_messages"] == report["restarts"] == 0
