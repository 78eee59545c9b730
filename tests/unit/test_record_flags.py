"""`encircle run --record [FILE]`, and the tables of record, replay and remap."""

from pathlib import Path

import pytest

from schemas.codec import encode
from services.launcher.errors import LauncherError, SettingsError
from services.launcher.flags import parse_run
from services.launcher.processes import process_table
from services.launcher.remap import remap
from services.launcher.remap_settings import RemapSettings, recorded_argv
from services.launcher.results import Results
from services.launcher.settings import RUNS_OWN, RunSettings
from services.mapper.settings import MapperSettings
from services.recorder.log_file import RecordedLog
from services.recorder.log_writer import LogWriter
from services.recorder.settings import RecorderSettings, ReplaySettings, all_keys
from services.runtime.service import parse
from services.runtime.tap import Sample
from tests.examples import ENVELOPE, EXAMPLES

pytestmark = pytest.mark.unit

ENDPOINT = "tcp/127.0.0.1:7999"


@pytest.mark.parametrize(
    ("args", "record"),
    [
        ([], None),
        (["--record"], RUNS_OWN),
        (["--record", "--headless"], RUNS_OWN),
        (["--headless", "--record", "a.mcap"], Path("a.mcap")),
        (["--record", "a.mcap", "--seed", "3"], Path("a.mcap")),
    ],
)
def test_a_name_may_follow_record(args: list[str], record: Path | None) -> None:
    assert parse_run(args, {}).record == record


def test_a_recording_of_another_name_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"must end with \.mcap"):
        parse_run(["--record", "a.bag"], {})


def test_a_recording_that_is_there_is_not_replaced(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    file.write_bytes(b"precious")
    with pytest.raises(LauncherError, match="exists"):
        Results.create(RunSettings(record=file, runs=tmp_path / "runs"))
    assert file.read_bytes() == b"precious"


def test_only_a_run_that_is_recorded_has_a_recorder(tmp_path: Path) -> None:
    names = [spec.name for spec in process_table(RunSettings(), ENDPOINT)]
    assert "recorder" not in names
    settings = RunSettings(record=RUNS_OWN, voxel_size=0.02)
    specs = {spec.name: spec for spec in process_table(settings, ENDPOINT, tmp_path)}
    recorder = parse(RecorderSettings, "recorder", specs["recorder"].argv[3:])
    assert recorder.file == tmp_path / "recording.mcap"
    assert recorder.keys == ()
    assert recorder.bus.connect == ENDPOINT
    assert RunSettings.model_validate_json(recorder.about) == settings


def test_a_recorder_that_is_started_again_takes_the_next_name(tmp_path: Path) -> None:
    settings = RecorderSettings(file=tmp_path / "a.mcap", numbered=True)
    names = []
    for _ in range(3):
        names.append(settings.path().name)
        settings.path().touch()
    assert names == ["a.mcap", "a-2.mcap", "a-3.mcap"]


def test_the_command_line_names_file_and_keys() -> None:
    settings = parse(RecorderSettings, "record", ["out.mcap", "cams/*/pose", "sim/**"])
    assert (settings.file, settings.keys) == (Path("out.mcap"), ("cams/*/pose", "sim/**"))
    assert parse(RecorderSettings, "record", []).expressions() == all_keys()
    replay = parse(
        ReplaySettings, "replay", ["a.mcap", "--rate", "2", "--loop", "--keys", "sim/*", "map/*"]
    )
    assert (replay.file, replay.rate, replay.loop) == (Path("a.mcap"), 2.0, True)
    assert replay.keys == ("sim/*", "map/*")


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["a.mcap", "--keys", "a//b"], "empty chunks"),
        (["a.mcap", "--prefix", "a/*"], "without"),
        (["a.mcap", "--rate", "0"], "greater than 0"),
        (["a.mcap", "--loop", "--hold"], "exclude each other"),
    ],
)
def test_wrong_flags_of_a_replay_are_named(args: list[str], says: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(ReplaySettings, "replay", args)
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


def test_a_namespace_and_a_prefix_are_both_before_the_key() -> None:
    settings = ReplaySettings(prefix="then", bus={"namespace": "lab"})
    assert settings.joining().namespace == "lab/then"


def test_a_recording_is_remapped_as_its_run_mapped_it_unless_told(tmp_path: Path) -> None:
    run = RunSettings(voxel_size=0.02, memory="decay", half_life=3.0, height=1.0)
    LogWriter(tmp_path / "a.mcap", {"run": run.model_dump_json()}).close({})
    with RecordedLog(tmp_path / "a.mcap") as log:
        argv, _ = recorded_argv(log)
    settings = parse(RemapSettings, "remap", [*argv, "a.mcap", "--half-life-s", "1.5"])
    assert (settings.voxel_size, settings.memory, settings.half_life_s) == (0.02, "decay", 1.5)
    assert settings.box_max_m == run.map_box[1]


def test_a_recording_that_knows_nothing_of_its_run_takes_the_mappers_defaults(
    tmp_path: Path,
) -> None:
    for about in ({}, {"run": '{"of": "another version"}'}):
        LogWriter(tmp_path / "a.mcap", about, overwrite=True).close({})
        with RecordedLog(tmp_path / "a.mcap") as log:
            argv, why = recorded_argv(log)
        assert "defaults" in why
        settings = parse(RemapSettings, "remap", [*argv, "a.mcap"])
        assert settings.voxel_size == MapperSettings().voxel_size


def test_what_cannot_be_remapped_is_named(tmp_path: Path) -> None:
    LogWriter(tmp_path / "a.mcap", {}).close({})
    (tmp_path / "b.mcap").write_bytes(b"garbage")
    for file, says in (
        ("a.mcap", "nothing to fuse"),
        ("b.mcap", "no MCAP file"),
        ("c.mcap", "cannot be read: No such file"),
    ):
        with pytest.raises(LauncherError, match=says):
            remap([str(tmp_path / file)])
    with pytest.raises(SettingsError, match="name a recording"):
        remap([])


@pytest.fixture
def a_recording(tmp_path: Path) -> Path:
    """One that has an instant to fuse, and words on its run that are no JSON."""
    log = LogWriter(tmp_path / "a.mcap", {"run": "started by hand"})
    for topic, message in (EXAMPLES["target_pose"], EXAMPLES["depth_cloud"]):
        key = topic.key_for(getattr(message, "camera", None))
        log.write(Sample(key, encode(message, ENVELOPE).join(), 1, None))
    log.close({})
    return tmp_path / "a.mcap"


@pytest.mark.parametrize("name", ["a.mcap", "again.mcap", "../{}/a.mcap"])
def test_a_remap_never_writes_over_its_recording(a_recording: Path, name: str) -> None:
    before = a_recording.read_bytes()
    target = a_recording.parent / name.format(a_recording.parent.name)
    if name == "again.mcap":
        target.symlink_to(a_recording)
    with pytest.raises(SettingsError, match="is the recording"):
        remap([str(a_recording), "--json", str(target)])
    assert a_recording.read_bytes() == before


@pytest.mark.parametrize(("flag", "name"), [("--json", "no/figures.json"), ("--out", "no/map.ply")])
def test_what_cannot_be_written_is_named_before_the_work(
    a_recording: Path, flag: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.launcher.remap._remap", lambda *_: pytest.fail("it worked"))
    target = a_recording.parent / name
    with pytest.raises(LauncherError, match=rf"{target} cannot be written: No such file"):
        remap([str(a_recording), flag, str(target)])


def test_words_on_the_run_that_tell_no_radius_are_named_where_it_is_needed(
    a_recording: Path,
) -> None:
    with pytest.raises(LauncherError, match=r"--score needs the run's radius.*'started by hand'"):
        remap([str(a_recording), "--score"])


def test_what_comes_first_is_the_recording_whatever_its_name(a_recording: Path) -> None:
    other = a_recording.rename(a_recording.with_suffix(".bag"))
    with pytest.raises(SettingsError, match="is the recording"):
        remap([str(other), "--json", str(other)])
    with pytest.raises(LauncherError, match=r"b\.bag cannot be read"):
        remap(["--json", "not.mcap", str(other.with_stem("b"))])
