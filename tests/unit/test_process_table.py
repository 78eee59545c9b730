"""The process table: who is started, and with what."""

import sys

import pytest

from services.launcher.processes import process_table
from services.launcher.settings import RunSettings

pytestmark = pytest.mark.unit

ENDPOINT = "tcp/127.0.0.1:7999"


def table(**settings):
    specs = process_table(RunSettings(**settings), ENDPOINT)
    return {spec.name: spec for spec in specs}


def flag(spec, name):
    """Return what follows a flag, up to the next one."""
    rest = spec.argv[spec.argv.index(f"--{name}") + 1 :]
    end = next((i for i, word in enumerate(rest) if word.startswith("--")), len(rest))
    return rest[:end]


@pytest.mark.parametrize("cameras", [1, 6, 64])
def test_there_is_one_process_per_service_and_one_per_camera(cameras):
    names = list(table(cameras=cameras))
    assert names[:5] == ["router", "simulator", "planner", "mapper", "evaluator"]
    assert names[5:] == [f"camera/{index}" for index in range(cameras)]


def test_everybody_connects_to_the_router():
    specs = table()
    assert flag(specs.pop("router"), "listen") == (ENDPOINT,)
    assert {flag(spec, "bus.connect") for spec in specs.values()} == {(ENDPOINT,)}


def test_every_process_is_this_python_running_a_module_of_ours():
    for spec in table().values():
        assert spec.argv[:2] == (sys.executable, "-m")
        assert spec.argv[2].startswith("services.")


def test_without_an_evaluator_nobody_waits_for_it():
    assert flag(table()["simulator"], "wait-for") == (
        *("planner", "mapper", "evaluator", "launcher"),
    )
    specs = table(evaluator=False)
    assert "evaluator" not in specs
    assert flag(specs["simulator"], "wait-for") == ("planner", "mapper", "launcher")


def test_services_agree_on_what_concerns_several():
    specs = table(cameras=3, height=0.6, rate=10.0, seed=7)
    assert flag(specs["simulator"], "cameras") == flag(specs["planner"], "cameras") == ("3",)
    assert flag(specs["simulator"], "dt-s") == flag(specs["planner"], "dt-s") == ("0.1",)
    assert flag(specs["planner"], "centre-height-m") == ("0.3",)
    assert flag(specs["simulator"], "seed") == flag(specs["camera/2"], "seed") == ("7",)


@pytest.mark.parametrize(
    ("settings", "ticks"), [({}, "600"), ({"duration": 2.0}, "30"), ({"forever": True}, "0")]
)
def test_the_simulator_knows_when_to_finish(settings, ticks):
    assert flag(table(**settings)["simulator"], "max-ticks") == (ticks,)


def test_the_maps_box_holds_an_object_of_any_height():
    for height in (0.1, 0.4, 2.0):
        mapper = table(height=height)["mapper"]
        low = [float(value) for value in flag(mapper, "box-min-m")]
        high = [float(value) for value in flag(mapper, "box-max-m")]
        assert low[2] < 0 < 1.2 * height < high[2]
        assert min(high[0], high[1], -low[0], -low[1]) >= 1.4 * height


def test_a_map_that_its_object_would_leave_is_refused():
    with pytest.raises(ValueError, match="choose path static or frame target"):
        RunSettings(frame="world", path="ellipse")
    assert RunSettings(frame="world", path="static").map_box
