"""Settings of a run: the order of sources, and how a wrong value is answered."""

from pathlib import Path

import pytest

from services.launcher.errors import SettingsError
from services.launcher.layers import Layer, environment_layer, scenario_layer, settle
from services.launcher.settings import RunSettings

pytestmark = pytest.mark.unit

SCENARIOS = sorted((Path(__file__).parents[2] / "scenarios").glob("*.toml"))


def write(tmp_path, text):
    file = tmp_path / "x.toml"
    file.write_text(text)
    return file


def test_the_shipped_scenarios_are_there():
    names = {path.stem for path in SCENARIOS}
    assert {"hexagon", "triangle", "single_camera", "deforming"} <= names


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_shipped_scenario_is_valid_and_every_key_is_commented(path):
    settle([scenario_layer(path)])
    lines = path.read_text().splitlines()
    keys = [line for line in lines if "=" in line and not line.startswith("#")]
    assert keys
    assert all("  # " in line for line in keys)


def test_environment_overrides_scenario_overrides_default(tmp_path):
    scenario = scenario_layer(write(tmp_path, "cameras = 3\nheight = 0.5\n"))
    environment = environment_layer({"ENCIRCLE_RUN_CAMERAS": "4", "HOME": "/root"})
    settings = settle([scenario, environment])
    assert (settings.cameras, settings.height, settings.seed) == (4, 0.5, 0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("camera = 3", r"x\.toml: unknown key 'camera'; did you mean 'cameras'\? known: .*object"),
        ("scenario = 'y'", r"x\.toml: unknown key 'scenario'"),
        ("cameras = 65", r"x\.toml: cameras = 65: .*less than or equal to 64"),
        ("mode = 'fast'", r"x\.toml: mode = 'fast': .*'lockstep' or 'realtime'"),
        ("resolution = '640'", r"x\.toml: resolution = '640': must be WIDTHxHEIGHT"),
        ("resolution = '1x1'", r"x\.toml: resolution = '1x1': must be WIDTHxHEIGHT"),
        ("cameras = \n", r"x\.toml: not TOML: .*line 1"),
        (
            "save_map = 'map.txt'",
            r"x\.toml: save_map = 'map\.txt': must end with one of \.npz \.ply \.bt",
        ),
        ("forever = true\nduration = 3", r"x\.toml: forever and duration exclude each other"),
    ],
)
def test_a_wrong_scenario_names_file_key_value_and_rule(tmp_path, text, complaint):
    with pytest.raises(SettingsError, match=complaint):
        settle([scenario_layer(write(tmp_path, text))])


def test_each_wrong_value_is_blamed_on_its_source(tmp_path):
    scenario = scenario_layer(write(tmp_path, "cameras = 0\nseed = 1\n"))
    environment = environment_layer({"ENCIRCLE_RUN_SEED": "x"})
    with pytest.raises(SettingsError) as caught:
        settle([scenario, environment])
    blames = {line.split(":")[0].rsplit("/")[-1]: line for line in str(caught.value).splitlines()}
    assert "cameras = 0" in blames["x.toml"]
    assert "seed = 'x'" in blames["environment"]


def test_a_missing_scenario_is_named(tmp_path):
    with pytest.raises(SettingsError, match=r"none\.toml: cannot be read: No such file"):
        scenario_layer(tmp_path / "none.toml")


def test_a_misspelt_variable_is_named():
    with pytest.raises(SettingsError, match="ENCIRCLE_RUN_CAMERA: unknown; did you mean 'cameras'"):
        environment_layer({"ENCIRCLE_RUN_CAMERA": "3"})


@pytest.mark.parametrize(
    ("values", "ticks"),
    [({}, 600), ({"duration": 2}, 30), ({"forever": True}, None), ({"duration": 1e-9}, 1)],
)
def test_a_run_takes_one_lap_unless_told_otherwise(values, ticks):
    assert settle([Layer("test", values)]).num_ticks == ticks


def test_the_image_size_is_read_from_the_resolution():
    assert RunSettings(resolution="320x240").image_size == (320, 240)
