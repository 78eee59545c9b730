"""The command line: what it answers, and that it answers fast."""

import subprocess
import sys

import pytest

from services.launcher.cli import dispatch
from services.launcher.errors import SettingsError
from services.launcher.flags import parse_run

pytestmark = pytest.mark.unit


def test_help_names_every_command(capsys):
    assert dispatch(["--help"]) == 0
    text = capsys.readouterr().out
    for command in (
        "run",
        "convert",
        "plan",
        "simulator",
        "camera",
        "planner",
        "mapper",
        "evaluator",
        "router",
    ):
        assert f"  {command} " in text


def test_no_command_is_a_wish_for_help(capsys):
    assert dispatch([]) == 0
    assert "COMMAND --help" in capsys.readouterr().out


def test_an_unknown_command_is_answered_with_the_known_ones(capsys):
    assert dispatch(["fly"]) == 2
    assert "no command 'fly'; known: run, convert, plan, " in capsys.readouterr().err


def test_help_imports_nothing_that_is_slow():
    code = (
        "import sys; from services.launcher.cli import dispatch; dispatch(['--help']);"
        "slow = {'numpy', 'numba', 'zenoh', 'pydantic', 'tyro', 'rich'} & set(sys.modules);"
        "sys.exit(repr(slow) if slow else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_flags_override_environment_overrides_scenario(tmp_path):
    scenario = tmp_path / "x.toml"
    scenario.write_text("cameras = 3\nheight = 0.5\nseed = 1\n")
    environment = {"ENCIRCLE_RUN_CAMERAS": "4", "ENCIRCLE_RUN_SEED": "2"}
    settings = parse_run(["--scenario", str(scenario), "--seed", "5"], environment)
    assert (settings.height, settings.cameras, settings.seed) == (0.5, 4, 5)
    assert settings.scenario == scenario


def test_the_environment_may_name_the_scenario(tmp_path):
    scenario = tmp_path / "x.toml"
    scenario.write_text("cameras = 3\n")
    assert parse_run([], {"ENCIRCLE_RUN_SCENARIO": str(scenario)}).cameras == 3


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (["--cameras", "65"], "flag: cameras = 65: .*less than or equal to 64"),
        (["--resolution", "big"], "flag: resolution = 'big': must be WIDTHxHEIGHT"),
        (["--scenario", "none.toml"], r"none\.toml: cannot be read"),
        (["--forever", "--duration", "3"], "forever and duration exclude each other"),
        (["--frames-to-clear", "2"], "frames_to_clear 2 with memory instant"),
    ],
)
def test_a_wrong_flag_names_value_and_rule(args, complaint):
    with pytest.raises(SettingsError, match=complaint):
        parse_run(args, {})


def test_an_unknown_flag_ends_with_the_nearest_ones(capsys):
    with pytest.raises(SystemExit) as end:
        parse_run(["--camera", "3"], {})
    assert end.value.code == 2
    assert "--cameras" in "".join(capsys.readouterr())


def test_wrong_settings_end_the_command_with_code_2(capsys):
    assert dispatch(["run", "--cameras", "0"]) == 2
    assert "encircle run: flag: cameras = 0" in capsys.readouterr().err
