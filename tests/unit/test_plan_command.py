"""`encircle plan`: verdicts, exit codes, JSON and pictures."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from services.launcher.cli import dispatch
from services.launcher.errors import SettingsError
from services.launcher.flags import parse_run
from services.launcher.plan_command import make, refuse_infeasible
from services.launcher.plan_settings import PlanSettings, from_run, from_scenario, parse_plan
from services.launcher.settings import RunSettings

pytestmark = pytest.mark.unit

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.\d+", text)]


def test_without_flags_it_is_the_articles_ellipse_and_feasible(capsys):
    assert dispatch(["plan", "--check"]) == 0
    text = capsys.readouterr().out
    assert "circle, N = 6, d = 3.183 m, unicycle" in text
    assert "d_c 3.183 m for any angles, 3.676 m for these" in text
    assert text.strip().endswith("\nfeasible")
    rows = [numbers(line) for line in text.splitlines() if " .. " in line]
    assert len(rows) == 6
    assert [row[0] for row in rows] == [-120, -60, 0, 60, 120, 180]
    assert min(row[4] for row in rows) == 0.246
    assert max(row[5] for row in rows) == 0.829


def test_an_infeasible_wish_ends_with_one_and_says_what_would_do(capsys):
    assert dispatch(["plan", "--check", "--cameras", "5", "--radius-m", "5"]) == 1
    text = capsys.readouterr().out
    assert "is violated, 49.726 > 30 deg" in text
    assert "nearest feasible d = 3.200 m" in text


def test_what_has_no_angles_at_all_ends_with_one_too(capsys):
    flags = ["--strategy", "constant_angles", "--radius-m", "6", "--cameras", "5"]
    assert dispatch(["plan", *flags]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "infeasible: constant_angles, d = 6 m: theta_lower <= theta_upper" in captured.err
    assert dispatch(["plan", "--json", *flags]) == 1
    refusal = json.loads(capsys.readouterr().out)
    assert not refusal["feasible"]
    assert "nearest feasible d = 5.68" in refusal["refusal"]


def test_a_target_too_large_is_refused_with_the_greatest_that_is_not(capsys):
    flags = "--path circle --semi-axes-m 2 2 --beta-deg 40 --margin-deg 2 --target-radius-m 0.25"
    assert dispatch(["plan", *flags.split()]) == 1
    assert "0.25 > 0.212 m; nearest feasible R = 0.211 m" in capsys.readouterr().err
    assert dispatch(["plan", *flags.split(), "--radius-m", "0.7"]) == 1
    assert "no d is feasible: R <= sin(beta / 2)^2 / kappa_max" in capsys.readouterr().out


def test_json_has_the_same_verdict_for_machines(capsys):
    flags = "--json --strategy constant_angles --radius-m 5 --cameras 5"
    assert dispatch(["plan", *flags.split()]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["feasible"] is True
    assert report["refusal"] is None
    assert report["scale_m"] == pytest.approx([5.0, 5.0])
    assert report["critical_scale_m"] == pytest.approx(3.183, abs=5e-4)
    angles = np.degrees([robot["theta_rad"] for robot in report["robots"]])
    np.testing.assert_allclose(angles, [-108, -36, 57.36, 102.29, 167.14], atol=0.01)
    assert dispatch(["plan", "--json", "--radius-m", "5"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["refusal"].endswith("nearest feasible d = 3.675 m")


def test_every_limit_can_be_given(capsys):
    flags = (
        "--radius-m 3 --v-max-mps 0.7 --omega-max-dps 2 --robot-distance-m 4 --range-min-m 3.5 "
        "--range-max-m 2.5 --robot-radius-m 3.5 --beta-deg 20 --margin-deg 1 --delay-s 0.1 "
        "--bearing-noise-deg 0.5"
    )
    assert dispatch(["plan", *flags.split()]) == 1
    assert capsys.readouterr().out.count("\n  !!  ") == 8


def test_flying_cameras_are_not_bound_by_turns(capsys):
    assert dispatch(["plan", "--drive", "flying", "--radius-m", "20"]) == 0
    assert "the field of view does not bound the distance" in capsys.readouterr().out
    assert dispatch(["plan", "--drive", "flying"]) == 2
    assert "nothing bounds the scale" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--cameras", "0"], "--cameras 0: Input should be greater than or equal to 1"),
        (["--strategy", "spiral"], "--strategy spiral: Input should be 'circle', 'adaptive_scale'"),
        (["--strategy", "dome"], "drive unicycle with strategy dome: its cameras move about"),
        (["--strategy", "orbit", "--drive", "flying"], "nothing bounds the scale from above"),
        (["--beta-up-deg", "9", "--margin-deg", "9"], "leaves nothing of beta_up_deg 9"),
        (["--semi-axes-m", "1", "x"], "--semi-axes-m x: Input should be a valid number"),
        (["--beta-deg", "20", "--margin-deg", "20"], "leaves nothing of beta_deg 20"),
        (["--plot", "plan.gif"], "--plot plan.gif: must end with one of .png .svg .pdf"),
        (["--plot", "/nowhere/plan.png"], "--plot /nowhere/plan.png: No such file or directory"),
        (["--scenario", "none.toml"], "none.toml: cannot be read"),
    ],
)
def test_a_wrong_flag_ends_with_two_and_names_its_rule(flags, complaint, capsys):
    assert dispatch(["plan", *flags]) == 2
    assert complaint in capsys.readouterr().err


def test_an_unknown_flag_ends_with_two(capsys):
    with pytest.raises(SystemExit) as exit_:
        dispatch(["plan", "--colour", "red"])
    assert exit_.value.code == 2
    assert "--colour" in capsys.readouterr().err


def test_a_scenario_is_planned_as_it_is_run_and_flags_win(tmp_path):
    scenario = tmp_path / "x.toml"
    scenario.write_text("cameras = 3\nradius = 2.0\nelevation = 60\nheight = 0.5\nlap = 30\n")
    settings = parse_plan(["--scenario", str(scenario), "--cameras", "4"])
    assert (settings.cameras, settings.lap_s, settings.target_radius_m) == (4, 30, 0.25)
    assert (settings.radius_m, settings.elevation_deg) == (2.0, 60)
    assert settings.beta_up_deg == 22.5
    assert (settings.v_max_mps, settings.range_max_m) == (2.0, 5.0)
    assert settings.beta_deg == pytest.approx(28.91, abs=5e-3)  # 640x480, 45 degrees upright.
    assert settings.semi_axes_m == (1.6, 1.2)
    assert settings.drive == "flying"
    assert set(from_scenario(scenario)) <= set(PlanSettings.model_fields)


def test_a_scenario_on_wheels_is_bound_by_its_turns(tmp_path, capsys):
    scenario = tmp_path / "wheels.toml"
    scenario.write_text(
        'drive = "unicycle"\nsemi_axes = [4.0, 3.2]\nlap = 60\nradius = 0.8\nvfov = 64.4\n'
    )
    assert dispatch(["plan", "--scenario", str(scenario), "--margin-deg", "2"]) == 0
    assert "whole target at d from 0.417 m to 1.227 m, seen from above" in capsys.readouterr().out
    assert dispatch(["plan", "--scenario", str(scenario), "--radius-m", "1.8"]) == 1


def test_the_scenario_on_wheels_has_room_for_late_and_noisy_robots(capsys):
    wheels = ["--scenario", str(SCENARIOS / "wheels.toml")]
    noisy = ["--delay-s", "0.1", "--bearing-noise-deg", "0.5"]
    assert dispatch(["plan", *wheels, *noisy, "--margin-deg", "5"]) == 0
    assert "unicycle" in capsys.readouterr().out
    assert dispatch(["plan", *wheels, *noisy, "--margin-deg", "4"]) == 1
    assert "<= margin is violated, 4.3798 > 4 deg" in capsys.readouterr().out


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_scenario_is_feasible(path, capsys):
    assert dispatch(["plan", "--scenario", str(path)]) == 0
    assert "max |gamma_ri| + gamma_R <= gamma holds" in capsys.readouterr().out


def rules_of(capsys, flags):
    dispatch(["plan", "--json", *flags.split()])
    rules = json.loads(capsys.readouterr().out)["rules"]
    return {rule["name"]: rule["value"] for rule in rules}


def test_cameras_on_rings_are_as_far_apart_as_they_are_in_space(capsys):
    flags = (
        "--strategy rings --drive flying --cameras 2 --rings 2 --elevation-deg 0 --radius-m 2 "
        "--top-elevation-deg 60 --robot-radius-m 0.1 --robot-distance-m 0.1 --path static"
    )
    known = rules_of(capsys, flags)
    assert known["target apart"] == pytest.approx(2.0)  # The upper one, from above: 1 m.
    # One above the other, opposite each other: 120 degrees between them.
    assert known["robots apart"] == pytest.approx(2 * 2 * np.sin(np.radians(60)))


@pytest.mark.parametrize(
    ("flags", "rule", "value"),
    [
        # 2 m about the target at 90 degrees a second, and 0.1 m/s of its own.
        ("--strategy orbit --orbit-deg-s 90 --path line --lap-s 32", "speed", np.pi + 0.1),
        ("--strategy orbit --orbit-deg-s 90 --path static", "turning", np.pi / 2),
        # The target drives out of the ring: 3.2 m on, 2 m beyond the farther camera's back.
        ("--strategy static --path line --lap-s 32", "field of view", np.pi),
        ("--strategy circle --elevation-deg 30 --path line", "target apart", 2.0),
        ("--strategy sphere --elevation-deg 10 --path eight", "far range", 2.0),
        ("--strategy random --elevation-deg 10 --path eight", "near range", 2.0),
    ],
)
def test_every_strategy_is_planned_with_its_own_numbers(flags, rule, value, capsys):
    more = "--drive flying --cameras 4 --radius-m 2 --semi-axes-m 1.6 1.2 --v-max-mps 9 "
    more += "--omega-max-dps 999 --range-min-m 0.1 --range-max-m 9 --robot-radius-m 0.1"
    known = rules_of(capsys, f"{flags} {more}")
    assert known[rule] == pytest.approx(value, abs=1e-6)


def test_robots_with_wheels_carry_rings_as_the_live_planner_tells_them(capsys):
    flags = "--strategy rings --cameras 4 --elevation-deg 10 --top-elevation-deg 10 --radius-m 3"
    rings = rules_of(capsys, flags)
    circle = rules_of(capsys, "--cameras 4 --elevation-deg 10 --radius-m 3")
    # Two rings of two at one height: the angles of two circles, whose worst is the circle's.
    assert 0 < rings["field of view"] <= circle["field of view"] + 1e-6
    assert dispatch(["plan", *flags.split(), "--radius-m", "9"]) == 1
    assert re.search(
        r"nearest feasible radius_m = 3\.\d+ or drive = flying", capsys.readouterr().out
    )


def test_too_many_cameras_are_refused_with_the_most_that_have_room(capsys):
    flags = "--cameras 12 --radius-m 2 --robot-distance-m 1.5"
    assert dispatch(["plan", *flags.split()]) == 1
    assert "nearest feasible d = 2.898 m or N = 8" in capsys.readouterr().out
    flags = "--strategy sphere --drive flying --cameras 24 --radius-m 2 --robot-distance-m 1.5"
    assert dispatch(["plan", *flags.split(), "--path", "static"]) == 1
    assert re.search(r"nearest feasible radius_m = .* or cameras = 1\d", capsys.readouterr().out)


def test_a_turning_circle_that_is_too_fast_is_refused_with_the_fastest_that_is_not(capsys):
    flags = "--strategy orbit --drive flying --radius-m 2 --orbit-deg-s -90 --v-max-mps 2"
    assert dispatch(["plan", *flags.split(), "--path", "static"]) == 1
    # 2 m/s at 2 m: 57.29 degrees a second.
    assert "or orbit_deg_s = -57.29" in capsys.readouterr().out


@pytest.mark.parametrize(
    "flags",
    [
        "--cameras 3",
        "--cameras 6 --strategy adaptive_scale",
        "--cameras 5 --strategy adaptive_angles --radius-m 5 --v-max-mps 1",
        "--cameras 13 --drive flying --radius-m 4 --target-radius-m 1 --path eight",
        "--cameras 2 --radius-m 1 --path static",
        "--cameras 1 --radius-m 9 --path line",
        "--cameras 2 --strategy adaptive_both --radius-m 4",
        "--cameras 8 --strategy rings --radius-m 2 --target-radius-m 0.2 --beta-up-deg 25",
        "--cameras 2 --strategy orbit --drive flying --radius-m 2",
        "--cameras 4 --strategy random --drive flying --radius-m 2 --elevation-deg 10",
        "--cameras 3 --strategy static --drive flying --radius-m 9 --path static",
        "--cameras 1 --strategy dome --drive flying --path static --lap-s 58",
        "--cameras 9 --strategy sphere --drive flying --radius-m 2",
    ],
)
def test_the_picture_shows_every_robot(flags, tmp_path):
    pytest.importorskip("matplotlib")
    path = tmp_path / "plan.svg"
    dispatch(["plan", "--plot", str(path), *flags.split()])
    texts = "".join(ET.parse(path).getroot().itertext())
    markup = path.read_text()
    num = int(flags.split()[1])
    assert markup.count("<!-- robot ") == (num if num <= 12 else 0)
    assert f"N = {num}" in markup or f"N = {num}" in texts


def test_a_picture_is_drawn_of_what_is_infeasible_too(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    path = tmp_path / "plan.png"
    assert dispatch(["plan", "--radius-m", "5", "--plot", str(path)]) == 1
    assert path.read_bytes().startswith(b"\x89PNG")
    assert "infeasible" in capsys.readouterr().out


def test_a_run_is_refused_before_anything_starts(tmp_path, capsys):
    flags = ["--strategy", "static", "--radius", "3", "--runs", str(tmp_path / "runs")]
    assert dispatch(["run", *flags]) == 2
    assert re.search(
        r"infeasible: static, N = 6, .*beta_ri.* > 28.911 deg; .*--infeasible allow runs it",
        capsys.readouterr().err,
    )
    assert not list(tmp_path.iterdir())
    refuse_infeasible(RunSettings(strategy="static", radius=3, infeasible="allow"))
    refuse_infeasible(RunSettings())


def test_a_run_is_refused_what_its_own_planner_would_refuse():
    """On a way that bends both ways bumps of the whole motion do what looking ahead cannot."""
    asked = "--path eight --strategy adaptive_angles --drive unicycle --cameras 4 --radius 1.4"
    lap = "--semi-axes 12 6 --lap 240 --elevation 0 --height 0.1"
    run = parse_run([*asked.split(), *lap.split()], {})
    assert make(PlanSettings.model_validate(from_run(run))).refusal is None
    with pytest.raises(SettingsError, match=r"field of view.*nearest feasible radius_m = 1\.2"):
        refuse_infeasible(run)
