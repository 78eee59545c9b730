"""A disk that takes no more stops nobody, and what comes after is recorded again."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from services.recorder.log_file import RecordedLog
from services.recorder.log_writer import LogWriter
from services.recorder.service import RecorderService
from services.recorder.settings import RecorderSettings
from services.recorder.steady_file import SteadyFile
from services.runtime.loop import Loop
from services.runtime.tap import Sample
from tests.integration.conftest import running
from tests.integration.recording_world import OpenBus, recording, wait_until_heard

pytestmark = pytest.mark.integration

NOISE = np.random.default_rng(0).bytes(50_000)


@contextmanager
def room_for(num_bytes: int) -> Iterator[None]:
    """Let no file of this process grow beyond, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_the_disk_did_not_take_it_takes_when_there_is_room(tmp_path: Path) -> None:
    file = SteadyFile(tmp_path / "a")
    rng = np.random.default_rng(1)
    parts = [rng.bytes(int(size)) for size in rng.integers(0, 5000, 60)]
    with room_for(40_000):
        for part in parts[:40]:
            assert file.write(part) == len(part)
        assert file.held_up
        assert "large" in file.error
    for part in parts[40:]:
        file.write(part)
    assert not file.held_up
    assert file.tell() == sum(map(len, parts))
    assert file.close() == 0
    assert (tmp_path / "a").read_bytes() == b"".join(parts)


def test_a_recording_over_a_full_disk_is_whole_when_there_is_room_again(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "a.mcap", {})
    samples = [Sample("k", NOISE[index:], 10**18 + index, None) for index in range(60)]
    for index, sample in enumerate(samples):
        with room_for(1_000_000 if index < 40 else 100_000_000):
            log.write(sample)
            log.flush()
            assert bool(log.held_up) == (19 <= index < 40)
    assert log.close({}) == 0
    with RecordedLog(tmp_path / "a.mcap") as read:
        assert [record.payload for record in read] == [sample.payload for sample in samples]
        assert read.lost == []


def test_a_recorder_waits_for_room_counts_what_it_drops_and_goes_on(
    open_bus: OpenBus, tmp_path: Path
) -> None:
    sender, asker = open_bus("simulator"), open_bus("launcher")
    path = tmp_path / "a.mcap"

    def state() -> dict:
        return asker.request("recorder", "get")

    with recording(open_bus("recorder"), path, keys=("k",), queue_mib=1):
        wait_until_heard(sender, "k")
        num = 0

        def say() -> None:
            nonlocal num
            sender.republish("k", num.to_bytes(4, "little") + NOISE)
            num += 1

        with room_for(500_000):
            while not state()["held_up"]:
                say()
            while not state()["dropped"]:
                say()
            assert "large" in state()["held_up"]
            assert state()["waiting_bytes"] <= 1 << 20
        while state()["held_up"] or state()["waiting_bytes"]:
            pass
        say()
        while state()["waiting_bytes"]:
            pass
        dropped = state()["dropped"]["k"]
    with RecordedLog(path) as log:
        numbers = [int.from_bytes(record.payload[:4], "little") for record in log]
        assert log.lost == []
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == num - 1
    assert len(numbers) + dropped == num


def test_a_recorder_that_never_got_room_says_so_and_fails(open_bus: OpenBus, caplog) -> None:
    bus = open_bus("recorder")
    loop = Loop(bus)
    settings = RecorderSettings(file=Path("/dev/full"), overwrite=True, keys=("k",))
    service = RecorderService(settings, bus, loop)
    sender, asker = open_bus("simulator"), open_bus("launcher")
    failed: list[SystemExit] = []
    end = service._end

    def fails() -> None:
        try:
            end()
        except SystemExit as error:
            failed.append(error)

    loop._endings[:] = [fails]
    with running(loop):
        wait_until_heard(sender, "k")
        sender.republish("k", NOISE)
        while not asker.request("recorder", "get")["held_up"]:
            pass
    assert failed[0].code == 1
    assert "No space left on device" in caplog.text
    assert "lacks its end" in caplog.text
