"""A recording's time against ours, without a clock."""

from pathlib import Path

import pytest

from services.recorder.errors import RecorderError
from services.recorder.log_file import RecordedLog
from services.recorder.log_writer import LogWriter
from services.recorder.playback import Playback
from services.runtime.tap import Sample

pytestmark = pytest.mark.unit

START_NS = 10**18


@pytest.fixture
def log(tmp_path: Path):
    """Eleven samples, 0.1 s after one another."""
    writer = LogWriter(tmp_path / "a.mcap", {})
    for index in range(11):
        writer.write(Sample("k", bytes([index]), START_NS + index * 100_000_000, None))
    writer.close({})
    with RecordedLog(tmp_path / "a.mcap") as log:
        yield log


def taken(playback: Playback, now_s: float) -> list[int]:
    got = []
    while (record := playback.take(now_s)) is not None:
        got.append(record.payload[0])
    return got


@pytest.mark.parametrize("rate", [0.25, 1.0, 3.0, 1000.0])
def test_at_any_time_that_has_been_taken_whose_time_has_come(log, rate: float) -> None:
    playback, got = Playback(log, rate=rate), []
    playback.resume(50.0)
    for step in range(81):
        now_s = 50.0 + step * 0.05
        got += taken(playback, now_s)
        due = min(11, 1 + int(step * 0.05 * rate / 0.1 + 1e-6))
        assert got == list(range(due))


def test_waiting_as_long_as_told_brings_the_next(log) -> None:
    playback, now_s = Playback(log, rate=2.0), 7.0
    playback.resume(now_s)
    for index in range(11):
        now_s += playback.wait_s(now_s) + 1e-9
        assert taken(playback, now_s) == [index]
    assert playback.wait_s(now_s) is None
    assert playback.ended


def test_a_pause_takes_no_time_of_the_recording(log) -> None:
    playback = Playback(log)
    playback.resume(0.0)
    assert taken(playback, 0.35) == [0, 1, 2, 3]
    playback.pause(0.35)
    assert taken(playback, 99.0) == []
    assert playback.wait_s(99.0) is None
    assert playback.position_s(99.0) == pytest.approx(0.35)
    playback.resume(100.0)
    assert taken(playback, 100.04) == []
    assert taken(playback, 100.06) == [4]


def test_resuming_what_plays_changes_nothing(log) -> None:
    playback = Playback(log)
    playback.resume(0.0)
    assert taken(playback, 0.45) == [0, 1, 2, 3, 4]
    playback.resume(0.45)
    assert playback.position_s(0.45) == pytest.approx(0.45)
    assert taken(playback, 0.55) == [5]


def test_another_rate_goes_on_from_where_it_is(log) -> None:
    playback = Playback(log)
    playback.resume(0.0)
    taken(playback, 0.45)
    playback.set_rate(10.0, 0.45)
    assert playback.position_s(0.45) == pytest.approx(0.45)
    assert taken(playback, 0.476) == [5, 6, 7]


@pytest.mark.parametrize("t_s", [0.0, 0.3, 0.31, 1.0])
def test_a_leap_goes_to_the_first_not_before(log, t_s: float) -> None:
    playback = Playback(log)
    playback.resume(0.0)
    taken(playback, 0.55)
    playback.seek(t_s, 3.0)
    assert taken(playback, 10.0) == [index for index in range(11) if index * 0.1 >= t_s - 1e-9]


def test_at_the_end_resuming_begins_anew(log) -> None:
    playback = Playback(log)
    playback.resume(0.0)
    taken(playback, 5.0)
    assert playback.position_s(9.0) == playback.duration_s == 1.0
    playback.resume(20.0)
    assert taken(playback, 20.15) == [0, 1]


@pytest.mark.parametrize("t_s", [-0.1, 1.1, float("nan")])
def test_a_leap_out_of_the_recording_is_refused(log, t_s: float) -> None:
    with pytest.raises(RecorderError, match=r"must be 0\.\.1\.000"):
        Playback(log).seek(t_s, 0.0)
