"""What cannot be simulated is refused before anything starts."""

import pytest
from pydantic import ValidationError

from services.simulator.settings import SimulatorSettings

pytestmark = pytest.mark.unit

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 2\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


def test_the_defaults_are_the_main_job():
    settings = SimulatorSettings()
    assert (settings.object, settings.cameras, settings.mode) == ("bunny", 6, "lockstep")
    assert settings.motion().period_s == 40.0
    assert settings.dt_ns == 66_666_667
    assert settings.num_ticks is None


@pytest.mark.parametrize(
    ("limits", "num_ticks"),
    [
        ({"max_ticks": 7}, 7),
        ({"duration_s": 10.0}, 150),
        ({"duration_s": 10.0, "max_ticks": 7}, 7),
        ({"duration_s": 0.1, "max_ticks": 7}, 2),
        ({"duration_s": 0.001}, 1),
    ],
)
def test_the_nearer_end_counts_and_a_short_run_has_a_tick(limits, num_ticks):
    assert SimulatorSettings(**limits).num_ticks == num_ticks


@pytest.mark.parametrize(
    ("wrong", "rule"),
    [
        ({"object": "rabbit"}, "known: bunny, sphere, box, torus"),
        ({"deformation": "melt"}, "known: rigid, breathing"),
        ({"deformation": "wave:1.5"}, "wave amplitude must be"),
        ({"path": "spiral"}, "'ellipse', 'line', 'circle', 'eight' or 'static'"),
        ({"semi_axes_m": (0.0, 1.0)}, "greater than 0"),
        ({"cameras": 0}, "greater than or equal to 1"),
    ],
)
def test_a_wrong_setting_names_the_rule(wrong, rule):
    with pytest.raises(ValidationError, match=rule):
        SimulatorSettings(**wrong)


def test_a_setting_comes_from_the_environment(monkeypatch):
    monkeypatch.setenv("ENCIRCLE_SIMULATOR_OBJECT", "torus")
    monkeypatch.setenv("ENCIRCLE_SIMULATOR_UP", "z")
    with pytest.raises(ValidationError, match="torus stands upright already"):
        SimulatorSettings()
    monkeypatch.delenv("ENCIRCLE_SIMULATOR_UP")
    assert SimulatorSettings().scene(0).object == "torus"


def test_a_mesh_file_is_named_so_that_processes_elsewhere_find_it(tmp_path, monkeypatch):
    (tmp_path / "t.off").write_text(TETRAHEDRON)
    monkeypatch.chdir(tmp_path)
    settings = SimulatorSettings(object="t.off", up="x")
    assert settings.scene(0).object == f"{tmp_path.resolve() / 't.off'}:x"
