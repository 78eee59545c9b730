"""Missing clouds are told once, not once per instant, and none goes uncounted."""

import re

import numpy as np
import pytest

from services.mapper.silence import PERIOD_S, Silence

pytestmark = pytest.mark.unit

ALL = (0, 1, 2)
DT_S = 1 / 15


def told(absences: list[set[int]]) -> list[str]:
    """Say instants at 15 Hz, each lacking some cameras."""
    silence = Silence()
    return [
        line
        for tick, missing in enumerate(absences)
        for line in silence.note(tick, set(ALL) - missing, missing, 100.0 + tick * DT_S)
    ]


def test_nothing_is_said_while_all_speak() -> None:
    assert told([set()] * 1000) == []


def test_a_camera_that_falls_silent_is_told_at_once_and_its_return_too() -> None:
    lines = told([set()] * 3 + [{1}] * 5 + [set()] * 3)
    assert lines == ["tick 3: nothing from cameras 1", "tick 8: cameras 1 speak again"]


def test_several_that_fall_silent_together_are_one_line() -> None:
    assert told([set(), {0, 2}]) == ["tick 1: nothing from cameras 0, 2"]


def test_a_long_silence_is_one_line_and_a_summary_every_period() -> None:
    lines = told([{1}] * (15 * 60))
    assert len(lines) <= 1 + 60 / PERIOD_S
    assert lines[0] == "tick 0: nothing from cameras 1"
    assert all("of camera 1" in line for line in lines[1:])


def test_a_camera_that_left_the_bus_does_not_speak_again() -> None:
    silence = Silence()
    silence.note(0, {0}, {1}, 0.0)
    assert silence.note(1, {0}, set(), 0.1) == []
    assert silence.note(2, {0, 1}, set(), 0.2) == []


@pytest.mark.parametrize("seed", range(5))
def test_whatever_is_missing_the_lines_are_few_and_every_cloud_is_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    span_s = 95.0
    absences = [{camera for camera in ALL if rng.random() < 0.4} for _ in range(int(span_s / DT_S))]
    silence, lines, counted = Silence(), [], 0
    for tick, missing in enumerate(absences):
        lines += silence.note(tick, set(ALL) - missing, missing, tick * DT_S)
    # One of beginning and one of end per camera, and one summary, in each period.
    assert len(lines) <= (2 * len(ALL) + 1) * (span_s / PERIOD_S + 1)
    for line in lines:
        if "nothing from" in line:
            counted += len(re.findall(r"\d+", line.partition("cameras")[2]))
        counted += sum(int(count) for count in re.findall(r"(\d+) of camera", line))
    last = silence.note(len(absences), ALL, (), 2 * span_s)
    counted += sum(int(count) for line in last for count in re.findall(r"(\d+) of camera", line))
    assert counted == sum(map(len, absences))
