"""A ring on several hosts: namespaces with a wire between them that is bad, and that is cut."""

import json
from pathlib import Path

import pytest

from benchmarks.wire import lacking
from tests.e2e.benchmark_run import run

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.slow,
    pytest.mark.timeout(1000),
    pytest.mark.skipif(bool(lacking()), reason=lacking()),
]

LATE_S = 420.0
RATE_HZ = 10.0
LINK_MBIT_S = 50.0
CAMERA_MBIT_S = 12.8
"""Of 320 x 240 at 10 Hz."""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict:
    path = tmp_path_factory.mktemp("hosts") / "told.json"
    done = run("many_hosts.py", "--seconds", "6", "--json", str(path), timeout_s=LATE_S)
    assert done.returncode == 0, done.stdout
    return json.loads(path.read_text())


def flow_of(told: dict, *words: str) -> dict:
    (found,) = [each for each in told["flows"] if all(word in each["what"] for word in words)]
    return found


def carried(told: dict, wanted_mbit_s: float) -> float:
    """Return the share of a stream that this kernel's TCP brings over the link."""
    return min(1.0, 0.6 * told["alone_mbit_s"] / wanted_mbit_s)


@pytest.mark.parametrize("when", ["a perfect link", "loss", "after the cuts"])
def test_what_the_link_carries_is_in_the_map(told: dict, when: str) -> None:
    found = flow_of(told, "mTLS", when)
    share = 1.0 if "perfect" in when else carried(told, CAMERA_MBIT_S)
    assert found["instants_hz"] > 0.85 * RATE_HZ, found
    assert min(found["cameras_hz"]) > 0.7 * share * RATE_HZ, found
    assert found["age_p95_ms"] < 1000.0, found


def test_what_it_does_not_carry_is_dropped_and_nothing_grows_old(told: dict) -> None:
    found = flow_of(told, "640x480", "loss")
    left_hz = found["cameras_hz"][:2]  # They need twice their link.
    assert min(left_hz) > 0.5 * carried(told, LINK_MBIT_S / 2), found
    assert sum(left_hz) < RATE_HZ * 1.2, found
    least = 0.5 * carried(told, LINK_MBIT_S / 2) * LINK_MBIT_S
    assert least < found["left_mbit_s"] < 1.1 * LINK_MBIT_S, found
    assert found["later_p50_ms"] < 1500.0, found


def test_all_is_as_before_when_the_link_is_good_again(told: dict) -> None:
    found = flow_of(told, "640x480", "perfect again")
    assert min(found["cameras_hz"]) > 0.7 * RATE_HZ, found
    assert found["age_p95_ms"] < 1000.0, found


@pytest.mark.parametrize("host", ["left", "maps", "base"])
def test_a_host_that_was_cut_off_for_10_s_is_back_without_help(told: dict, host: str) -> None:
    (found,) = [each for each in told["cuts"] if each["host"] == host]
    assert found["again_s"] < 20.0, found


def test_nobody_else_stands_still_while_two_cameras_are_cut_off(told: dict) -> None:
    (found,) = [each for each in told["cuts"] if each["host"] == "left"]
    assert found["meanwhile_hz"] > 0.6 * RATE_HZ, found


def test_whoever_is_cut_off_finds_all_again(tmp_path: Path) -> None:
    path = tmp_path / "cuts.json"
    args = ("--cuts", "6", "--seconds", "1.5", "4", "--json", str(path))
    done = run("cuts.py", *args, timeout_s=LATE_S)
    assert done.returncode == 0, done.stdout
    assert all(each["again_s"] < 40.0 for each in json.loads(path.read_text())), done.stdout
