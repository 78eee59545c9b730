"""The process table: who is started, and with what."""

import sys

import pytest

from services.camera.settings import CameraSettings
from services.launcher.processes import process_table
from services.launcher.settings import RunSettings
from services.mapper.fusion import MemorySettings
from services.mapper.settings import MapperSettings
from services.planner.settings import PlannerSettings
from services.runtime.service import parse
from services.simulator.settings import SimulatorSettings
from services.viewer.settings import ViewerSettings

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
    assert names[5:-1] == [f"camera/{index}" for index in range(cameras)]
    assert names[-1] == "viewer"


def test_the_viewer_has_the_port_that_was_asked_for_and_may_be_left_out():
    viewer = table(viewer_port=9001)["viewer"]
    assert parse(ViewerSettings, "viewer", viewer.argv[3:]).port == 9001
    assert "viewer" not in table(viewer=False)


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
    assert RunSettings(frame="world", path="ellipse", follow="target").map_box


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        ({"follow": "target"}, "choose frame world, or follow none"),
        ({"frame": "world", "path": "static", "archive": True}, "archive with follow none"),
        ({"frame": "world", "follow": "target", "archive": True}, "and memory instant"),
    ],
)
def test_a_box_that_cannot_follow_is_refused_here_and_by_the_mapper(flags, says):
    with pytest.raises(ValueError, match=says):
        RunSettings(**flags)
    flags.pop("path", None)
    with pytest.raises(ValueError, match=r"follow|archive"):
        MapperSettings(**flags)


def test_a_mapper_is_told_what_its_box_follows():
    mapper = table(frame="world", follow="target", archive=True, memory="persistent")["mapper"]
    told = parse(MapperSettings, "mapper", mapper.argv[3:])
    assert (told.frame, told.follow, told.archive) == ("world", "target", True)
    assert "--archive" not in table()["mapper"].argv


def test_what_the_map_forgets_is_told_to_the_mapper():
    mapper = table(memory="decay", half_life=2.5, frames_to_clear=3)["mapper"]
    assert flag(mapper, "memory") == ("decay",)
    assert flag(mapper, "half-life-s") == ("2.5",)
    assert flag(mapper, "frames-to-clear") == ("3",)
    assert "--frames-to-appear" not in mapper.argv
    settings = parse(MapperSettings, "mapper", mapper.argv[3:])
    assert settings.memory_settings() == MemorySettings(
        memory="decay", half_life_s=2.5, frames_to_clear=3
    )


def test_all_who_are_concerned_are_told_of_the_drive():
    specs = table(
        drive="unicycle",
        controller="samson",
        actuator_lag=0.1,
        actuator_noise=0.02,
        actuator_turn_noise=0.03,
        semi_axes=(2.0, 1.6),
        vfov=64.4,
    )
    simulator = parse(SimulatorSettings, "simulator", specs["simulator"].argv[3:])
    actuator = simulator.actuator()
    assert (actuator.drive, actuator.lag_s) == ("planned", 0.1)
    assert (actuator.noise_m_s, actuator.noise_rad_s) == (0.02, 0.03)
    assert simulator.semi_axes_m == (2.0, 1.6)
    camera = parse(CameraSettings, "camera", specs["camera/4"].argv[3:])
    assert (camera.drive, camera.unicycle.controller, camera.vfov_deg) == (
        *("planned", "samson", 64.4),
    )
    assert parse(PlannerSettings, "planner", specs["planner"].argv[3:]).drive == "unicycle"


@pytest.mark.parametrize("strategy", ["orbit", "random", "dome"])
def test_wheels_are_not_asked_to_fly(strategy):
    with pytest.raises(ValueError, match=f"drive unicycle with strategy {strategy}"):
        RunSettings(drive="unicycle", strategy=strategy)


def test_the_planner_is_told_the_whole_formation():
    told = table(
        strategy="rings", rings=3, top_elevation=70.0, orbit=-5.0, redraw=2.0, change_speed=0.7,
        safe_distance=0.4, seed=9,
    )["planner"]  # fmt: skip
    formation = parse(PlannerSettings, "planner", told.argv[3:]).formation()
    assert (formation.strategy, formation.rings, formation.seed) == ("rings", 3, 9)
    assert (formation.top_elevation_deg, formation.orbit_deg_s) == (70.0, -5.0)
    assert (formation.redraw_s, formation.change_speed_mps) == (2.0, 0.7)
    assert formation.safe_distance_m == 0.4


def test_a_map_that_is_kept_survives_its_mapper_and_no_other_does(tmp_path):
    def snapshot(**settings):
        specs = process_table(RunSettings(**settings), ENDPOINT, tmp_path)
        (mapper,) = (spec for spec in specs if spec.name == "mapper")
        parse(MapperSettings, "mapper", mapper.argv[3:])  # It takes these flags together.
        return flag(mapper, "snapshot") if "--snapshot" in mapper.argv else None

    assert snapshot(memory="persistent") == (str(tmp_path / "snapshot.npz"),)
    assert snapshot(memory="instant") is snapshot(memory="decay") is None
    assert snapshot(memory="persistent", frame="world", follow="target") is None
