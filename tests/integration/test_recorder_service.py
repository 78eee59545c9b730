"""What is said is recorded; what was recorded is said again: each byte, each order."""

import json
import threading
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from schemas.map import MapFull
from schemas.topics import CAMERA_CLOUD, CAMERA_POSE, MAP_CHANGES, MAP_FULL, TARGET_POSE
from services.recorder.errors import BadRecording, CannotRecord, RecorderError
from services.recorder.log_file import RecordedLog
from services.recorder.log_writer import LogWriter
from services.recorder.service import RecorderService
from services.recorder.settings import RecorderSettings
from services.runtime.errors import CommandFailed, SettingsRefused
from services.runtime.loop import Loop, Timer
from services.runtime.map_follower import MapFollower
from services.runtime.map_mirror import MapMirror
from services.runtime.tap import Sample, Tap
from tests.examples import EXAMPLES
from tests.integration.conftest import running
from tests.integration.recording_world import (
    OpenBus,
    a_cloud,
    a_map,
    packed,
    recording,
    replaying,
    some_changes,
    until,
    wait_until_heard,
)

pytestmark = pytest.mark.integration

POSE = EXAMPLES["camera_pose"][1]
TARGET = EXAMPLES["target_pose"][1]
START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


def by_key(samples) -> dict[str, list[bytes]]:
    """Payloads of each key in order; what recorder and replay say of themselves excepted."""
    keys: dict[str, list[bytes]] = defaultdict(list)
    for sample in samples:
        if not sample.key.startswith("metrics/"):
            keys[sample.key].append(sample.payload)
    return keys


def write_log(path: Path, samples: list[tuple[str, bytes]], step_ns: int = STEP_NS) -> Path:
    """Write samples `step_ns` after one another."""
    log = LogWriter(path, {})
    for index, (key, payload) in enumerate(samples):
        log.write(Sample(key, payload, START_NS + index * step_ns, None))
    log.close({})
    return path


def poses(num: int) -> list[tuple[str, bytes]]:
    return [("target/pose", packed(TARGET, index, "simulator")) for index in range(num)]


def test_recorded_and_replayed_every_key_has_the_same_bytes_in_the_same_order(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    camera, target = open_bus("camera", "3"), open_bus("simulator")
    listener = open_bus("launcher")
    path = tmp_path / "a.mcap"
    keys = {CAMERA_CLOUD.key_for(3): 30, CAMERA_POSE.key_for(3): 60, TARGET_POSE.key: 30}
    with Tap(listener, ["**"]) as tap, recording(open_bus("recorder"), path):
        for bus, key in zip((camera, camera, target), keys, strict=True):
            wait_until_heard(bus, key)
        for index in range(30):
            camera.publish(CAMERA_POSE, POSE, camera=3)
            camera.publish(CAMERA_CLOUD, a_cloud(index, 3), camera=3)
            target.publish(TARGET_POSE, TARGET)
            camera.republish("cams/3/pose", bytes([index]))  # Also what is no message.
        sent: list[Sample] = []
        while not all(len(by_key(sent)[key]) == num for key, num in keys.items()):
            sent.append(tap.get(10))
        recorder = listener.request("recorder", "get")
        assert recorder["dropped"] == {}
    camera.close()
    target.close()
    assert camera.pool.used > 20  # 16 MiB hold so many at once.
    with RecordedLog(path) as log:
        recorded = by_key(log)
        assert log.lost == []
        assert json.loads(log.metadata["end"]["dropped"]) == {}
    assert recorded == by_key(sent)

    replay = open_bus("replay")
    with Tap(listener, ["**"]) as tap, replaying(replay, path, delay_s=0.5, rate=4):
        again: list[Sample] = []
        while not all(len(by_key(again)[key]) == num for key, num in keys.items()):
            again.append(tap.get(10))
    assert by_key(again) == by_key(sent)
    assert replay.pool.used == 30


def test_a_recorder_tells_what_it_does_and_counts_what_senders_lost(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    sender, asker = open_bus("simulator"), open_bus("launcher")
    with recording(open_bus("recorder"), tmp_path / "a.mcap", keys=("target/*",)):
        wait_until_heard(sender, "target/pose")
        for seq in (0, 1, 2, 7):
            sender.republish("target/pose", packed(TARGET, seq, "simulator"))
        while (state := asker.request("recorder", "get"))["records"] < 4:
            pass
    assert state["lost"] == {"target/pose": 4}
    assert state["bytes"] > 0
    assert state["held_up"] == ""
    with RecordedLog(tmp_path / "a.mcap") as log:
        assert set(log.channels) == {"target/pose"}
        assert json.loads(log.metadata["settings"]["recorder"])["keys"] == ["target/*"]
        assert [record.sequence for record in log] == [0, 1, 2, 7]


def test_what_is_no_key_of_ours_is_counted_and_not_recorded(
    open_bus: OpenBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.recorder.log_writer.MAX_KEYS", 3)
    sender, asker = open_bus("simulator"), open_bus("launcher")
    with recording(open_bus("recorder"), tmp_path / "a.mcap", keys=("**",)) as loop:
        wait_until_heard(sender, "k/0")
        for key in ("k/0", "metrics/" + "x" * 300, "k/1", "k/2", "k/3", "k/0"):
            sender.republish(key, b"x")
        while (state := asker.request("recorder", "get"))["records"] < 4:
            pass
        # What it says of itself has room for each key.
        assert all(len(meter.status(0.0).key) <= 256 for meter in loop.bus.meters)
    assert state["unkept"] == 2
    with RecordedLog(tmp_path / "a.mcap") as log:
        assert [record.key for record in log] == ["k/0", "k/1", "k/2", "k/0"]
        assert log.metadata["end"]["unkept"] == "2"


def test_a_clock_that_is_set_back_does_not_stop_the_recordings_time(
    open_bus: OpenBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sender, asker = open_bus("simulator"), open_bus("launcher")
    wall_ns = time.time_ns
    with recording(open_bus("recorder"), tmp_path / "a.mcap", keys=("target/*",)):
        wait_until_heard(sender, "target/pose")
        for seq in range(5):
            # Set back by an hour more before each.
            with monkeypatch.context() as patch:
                patch.setattr(time, "time_ns", lambda seq=seq: wall_ns() - seq * 3600 * 10**9)
                sender.republish("target/pose", packed(TARGET, seq, "simulator"))
                while asker.request("recorder", "get")["records"] <= seq:
                    pass
    with RecordedLog(tmp_path / "a.mcap") as log:
        times_ns = [record.log_ns for record in log]
    assert sorted(set(times_ns)) == times_ns  # Each later than the one before.
    assert times_ns[-1] <= wall_ns()


def test_answers_that_others_asked_for_are_no_losses(open_bus: OpenBus, tmp_path: Path) -> None:
    sender, asker = open_bus("mapper"), open_bus("launcher")
    full = a_map(np.random.default_rng(0), rev=5)
    with recording(open_bus("recorder"), tmp_path / "a.mcap", keys=("map/full", "target/pose")):
        wait_until_heard(sender, "map/full")
        for seq in (0, 3, 9):
            sender.republish("map/full", packed(full, seq))
        while (state := asker.request("recorder", "get"))["records"] < 3:
            pass
    assert state["lost"] == {}


def test_snapshots_of_the_map_are_recorded_as_they_were_answered(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    mapper, asker = open_bus("mapper"), open_bus("launcher")
    full = a_map(np.random.default_rng(0), rev=5)
    answers = Loop(mapper)
    answers.answer(MAP_FULL, lambda: full)
    with (
        running(answers),
        recording(
            open_bus("recorder"), tmp_path / "a.mcap", keys=("map/*",), snapshot_every_s=0.05
        ),
    ):
        while asker.request("recorder", "get")["records"] < 3:
            pass
    with RecordedLog(tmp_path / "a.mcap") as log:
        payloads = [record.payload for record in log if record.key == "map/full"]
        assert log.channels["map/full"].schema_name == "encircle.MapFull"
    assert len(payloads) >= 2
    for payload in payloads:
        assert full.data in payload


def test_a_file_that_cannot_be_written_is_refused(open_bus: OpenBus, tmp_path: Path) -> None:
    bus = open_bus("recorder")
    for path, says in ((tmp_path / "no" / "a.mcap", "No such file"), (tmp_path, "exists")):
        with pytest.raises(CannotRecord, match=says):
            RecorderService(RecorderSettings(file=path), bus, Loop(bus))


def test_a_fresh_viewer_in_the_middle_of_a_replay_gets_the_map_of_then(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    rng = np.random.default_rng(3)
    full = a_map(rng, rev=10)
    changes = [some_changes(rng, rev, rev - 1) for rev in range(8, 61)]
    samples = [("map/changes", packed(c, i)) for i, c in enumerate(changes)]
    samples.insert(5, ("map/full", packed(full, 0)))  # Asked for at rev 10, answered after 12.
    path = write_log(tmp_path / "a.mcap", samples, 20_000_000)
    truth = MapMirror()
    truth.reset(full)
    expected = {}
    for change in changes:
        truth.apply(change)
        expected[truth.rev] = truth.voxels
    viewer = open_bus("viewer")
    follower = MapFollower(viewer)
    with (
        replaying(open_bus("replay"), path, delay_s=0.3, hold=True),
        viewer.subscribe(MAP_CHANGES) as reader,
    ):
        while follower.mirror.rev < 60:
            if follower.take(reader.get(10)) is not None and follower.mirror.rev > 12:
                np.testing.assert_array_equal(follower.mirror.voxels, expected[follower.mirror.rev])
        last: MapFull = viewer.fetch(MAP_FULL)
    assert last.rev == 60


def test_after_a_leap_back_and_in_a_loop_the_map_is_that_of_the_time(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    rng = np.random.default_rng(4)
    full = a_map(rng, rev=1)
    changes = [some_changes(rng, rev, rev - 1) for rev in range(2, 42)]
    samples = [("map/full", packed(full, 0))]
    samples += [("map/changes", packed(c, i)) for i, c in enumerate(changes)]
    path = write_log(tmp_path / "a.mcap", samples)
    truth = MapMirror()
    truth.reset(full)
    expected = {1: truth.voxels}
    for change in changes:
        truth.apply(change)
        expected[truth.rev] = truth.voxels
    viewer = open_bus("viewer")
    follower = MapFollower(viewer)
    with (
        replaying(open_bus("replay"), path, delay_s=0.3, hold=True),
        viewer.subscribe(MAP_CHANGES) as reader,
    ):
        while follower.mirror.rev < 41:
            follower.take(reader.get(10))
        # The last of what was said is at 0.4 s; half of it is at 0.2.
        state = viewer.request("replay", "seek", {"t_s": 0.2})
        assert state["state"] in ("paused", "playing")
        seen = [follower.take(reader.get(10)) and follower.mirror.rev]
        np.testing.assert_array_equal(follower.mirror.voxels, expected[seen[0]])
        assert seen[0] == 20
        viewer.request("replay", "set", {"loop": True})
        viewer.request("replay", "resume")
        while len(seen) < 100:
            follower.take(reader.get(10))
            seen.append(follower.mirror.rev)
            np.testing.assert_array_equal(follower.mirror.voxels, expected[follower.mirror.rev])
    assert seen.count(1) >= 1  # It began anew.
    assert 41 in seen


def test_pause_seek_set_and_resume_steer_a_replay(open_bus: OpenBus, tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", poses(101))
    asker = open_bus("launcher")
    with (
        replaying(open_bus("replay"), path, delay_s=0.2, paused=True, hold=True),
        Tap(asker, ["target/pose"]) as tap,
    ):
        state = asker.request("replay", "get")
        assert (state["state"], state["duration_s"], state["position_s"]) == ("paused", 1.0, 0.0)
        asker.request("replay", "seek", {"t_s": 0.9})
        shown = tap.get(10)  # While it is paused: what was said last before.
        assert shown.payload == poses(101)[89][1]
        state = asker.request("replay", "set", {"rate": 0.5})
        assert (state["rate"], state["position_s"]) == (0.5, pytest.approx(0.9))
        asker.request("replay", "resume")
        assert until(tap, "target/pose", 11) == [payload for _, payload in poses(101)[90:]]
        while asker.request("replay", "get")["state"] != "ended":
            pass
        with pytest.raises(CommandFailed, match=r"t_s 1\.5 must be 0\.\.1\.000"):
            asker.request("replay", "seek", {"t_s": 1.5})
        with pytest.raises(CommandFailed, match="rate"):
            asker.request("replay", "set", {"rate": 0})
        with pytest.raises(CommandFailed, match="unknown parameter 'now'"):
            asker.request("replay", "pause", {"now": True})
        asker.request("replay", "resume")  # At the end: from the beginning.
        assert until(tap, "target/pose", 2) == [payload for _, payload in poses(2)]
        state = asker.request("replay", "pause")
        assert state["state"] == "paused"
        assert state["position_s"] == asker.request("replay", "get")["position_s"]


def test_nothing_is_said_before_its_time(open_bus: OpenBus, tmp_path: Path) -> None:
    """However busy the machine; that nothing is late by its own clock is the playback's test."""
    path = write_log(tmp_path / "a.mcap", poses(21))
    asker = open_bus("launcher")
    with (
        Tap(asker, ["target/pose"]) as tap,
        replaying(open_bus("replay"), path, delay_s=0.1, rate=0.5, paused=True, hold=True),
    ):
        began_ns = time.time_ns()
        asker.request("replay", "resume")
        late_ns = [tap.get(10).received_ns - began_ns for _ in range(21)]
    assert all(each >= index * STEP_NS / 0.5 * 0.99 for index, each in enumerate(late_ns))


def test_a_replay_ends_by_itself_at_the_end(open_bus: OpenBus, tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", poses(5))
    ended = threading.Event()
    with replaying(open_bus("replay"), path, delay_s=0.0) as loop:
        loop.at_end(ended.set)
        assert ended.wait(10)


@pytest.mark.parametrize(
    ("verb", "params"), [("seek", {"t_s": 0.0}), ("resume", {}), ("set", {"loop": True})]
)
def test_who_steers_on_at_the_end_keeps_the_replay_alive(
    open_bus: OpenBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str, params
) -> None:
    monkeypatch.setattr("services.recorder.replay_service._LINGER_S", 60.0)
    path = write_log(tmp_path / "a.mcap", poses(5), step_ns=10**8)
    asker = open_bus("launcher")
    with replaying(open_bus("replay"), path, delay_s=0.1, rate=10.0) as loop:

        def ends() -> list[Timer]:
            return [each for each in loop._timers if each.call == loop.stop and not each.cancelled]

        while asker.request("replay", "get")["state"] != "ended":
            pass
        assert ends()
        # So slow that it does not come to the end again.
        asker.request("replay", "set", {"rate": 0.001})
        assert ends()
        state = asker.request("replay", verb, params)
        assert state["state"] != "ended"
        assert not ends()


def test_what_nobody_reads_is_not_counted_as_said(open_bus: OpenBus, tmp_path: Path) -> None:
    clouds = [("cams/0/cloud", packed(a_cloud(seed), seq=seed)) for seed in range(3)]
    path = write_log(tmp_path / "a.mcap", [*poses(4), *clouds])
    asker = open_bus("launcher")
    with replaying(open_bus("replay"), path, delay_s=0.1, hold=True):
        while (state := asker.request("replay", "get"))["state"] != "ended":
            pass
    assert (state["said"], state["unread"]) == (4, 3)


def test_a_prefix_is_the_namespace_of_who_sees_it(open_bus: OpenBus, tmp_path: Path) -> None:
    from services.recorder.settings import ReplaySettings

    path = write_log(tmp_path / "a.mcap", poses(5))
    settings = ReplaySettings(file=path, prefix="then")
    assert settings.joining().namespace == "then"
    live = open_bus("simulator", announce=True)
    beside, viewer = open_bus("launcher"), open_bus("viewer", namespace="then")
    with (
        Tap(beside, ["**"]) as heard,
        Tap(viewer, ["target/pose"]) as tap,
        replaying(open_bus("replay", namespace=settings.joining().namespace), path, delay_s=0.3),
    ):
        assert until(tap, "target/pose", 5) == [payload for _, payload in poses(5)]
        wait_until_heard(live, "target/pose")
        live.republish("target/pose", b"now")
        while (sample := heard.get(10)).key != "target/pose":
            assert sample.key.startswith(("then/", "metrics/"))
        assert sample.payload == b"now"


def test_over_live_senders_a_replay_is_refused_and_says_who(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    path = write_log(tmp_path / "a.mcap", [*poses(5), ("metrics/simulator", b"beat")])
    open_bus("simulator", announce=True)
    bus = open_bus("replay")
    loop = Loop(bus)
    from services.recorder.replay_service import ReplayService
    from services.recorder.settings import ReplaySettings

    until_s = time.monotonic() + 10.0
    while "simulator/0" not in bus.presence.everybody():
        assert time.monotonic() < until_s, "they never met"
    ReplayService(ReplaySettings(file=path, delay_s=0.3), bus, loop)
    with pytest.raises(SettingsRefused, match=r"target/pose \(by simulator/0\) said live"):
        loop.run()


def test_what_a_live_service_says_of_itself_is_left_out(open_bus: OpenBus, tmp_path: Path) -> None:
    beat = ("metrics/viewer", b"beat")
    path = write_log(tmp_path / "a.mcap", [beat, *poses(5), beat])
    viewer = open_bus("viewer", announce=True)
    with (
        Tap(viewer, ["**"]) as tap,
        replaying(open_bus("replay"), path, delay_s=0.3, hold=True),
    ):
        got = until(tap, "target/pose", 5)
        while (state := viewer.request("replay", "get"))["state"] != "ended":
            pass
    assert state["skipped"] == ["metrics/viewer"]
    assert state["said"] == 5 == len(got)


def test_keys_choose_what_is_replayed(open_bus: OpenBus, tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", [*poses(3), ("formation", b"x"), *poses(3)])
    listener = open_bus("launcher")
    with (
        Tap(listener, ["target/pose", "formation"]) as tap,
        replaying(open_bus("replay"), path, delay_s=0.3, keys=("target/*",)) as loop,
    ):
        ended = threading.Event()
        loop.at_end(ended.set)
        assert ended.wait(10)
        keys = []
        while tap.waiting_bytes:
            keys.append(tap.get(0).key)
    assert keys == ["target/pose"] * 6


@pytest.mark.parametrize(
    ("settings", "error", "says"),
    [
        ({"file": None}, RecorderError, "name a recording"),
        ({"file": Path("nothing.mcap")}, BadRecording, "cannot be read: No such file"),
        ({"keys": ("cams/**",)}, RecorderError, "no such key; it has target/pose"),
        ({"start": 9.0}, RecorderError, r"t_s 9 must be 0\.\.0\.040"),
    ],
)
def test_what_cannot_be_replayed_is_refused(
    open_bus: OpenBus, tmp_path: Path, settings, error, says: str
) -> None:
    from services.recorder.replay_service import ReplayService
    from services.recorder.settings import ReplaySettings

    path = write_log(tmp_path / "a.mcap", poses(5))
    bus = open_bus("replay")
    with pytest.raises(error, match=says):
        ReplayService(ReplaySettings(**{"file": path, **settings}), bus, Loop(bus))
