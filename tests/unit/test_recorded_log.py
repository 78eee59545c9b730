"""What is written is read again, byte for byte, whole, torn, damaged or by others."""

import json

import msgpack
import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from schemas.codec import encode
from schemas.message import Envelope
from schemas.topics import TOPICS
from services.recorder.errors import BadRecording, CannotRecord
from services.recorder.log_file import RecordedLog
from services.recorder.log_writer import LogWriter
from services.recorder.message_schema import json_schema
from services.runtime.tap import Sample
from tests.examples import EXAMPLES

pytestmark = pytest.mark.unit

START_NS = 1_700_000_000_000_000_000
KEYS = ("cams/0/pose", "cams/1/cloud", "target/pose", "somebody/elses")


def some_samples(rng: np.random.Generator, num: int = 400) -> list[Sample]:
    samples = []
    for index in range(num):
        key = KEYS[rng.integers(len(KEYS))]
        size = int(rng.integers(0, 30_000 if "cloud" in key else 200))
        noise = rng.integers(0, 4, size).astype(np.uint8).tobytes()
        samples.append(Sample(key, noise, START_NS + index * 10_000_000, None))
    return samples


def write(path, samples, *, close=True, flush_every=None) -> LogWriter:
    log = LogWriter(path, {"rate": "15"})
    for index, sample in enumerate(samples):
        log.write(sample)
        if flush_every and index % flush_every == 0:
            log.flush()
    if close:
        assert log.close({"dropped": "0"}) == 0
    return log


def told(records) -> list[tuple[str, bytes, int]]:
    return [(record.key, record.payload, record.log_ns) for record in records]


def expected(samples) -> list[tuple[str, bytes, int]]:
    return [(sample.key, sample.payload, sample.received_ns) for sample in samples]


@pytest.fixture
def samples(rng) -> list[Sample]:
    return some_samples(rng)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def test_what_was_written_is_read_in_order_and_byte_for_byte(tmp_path, samples) -> None:
    write(tmp_path / "a.mcap", samples)
    with RecordedLog(tmp_path / "a.mcap") as log:
        assert told(log) == expected(samples)
        assert log.lost == []
        assert len(log) == len(samples)
        assert (log.start_ns, log.end_ns) == (samples[0].received_ns, samples[-1].received_ns)
        assert {key: channel.num_records for key, channel in log.channels.items()} == {
            key: sum(sample.key == key for sample in samples) for key in KEYS
        }
        assert log.metadata["settings"] == {"rate": "15"}
        assert log.metadata["end"] == {"dropped": "0"}
        assert log.metadata["encircle"]["encircle"]


def test_a_part_in_time_and_keys_is_what_filtering_the_whole_gives(tmp_path, samples, rng) -> None:
    write(tmp_path / "a.mcap", samples, flush_every=20)
    with RecordedLog(tmp_path / "a.mcap") as log:
        for _ in range(20):
            low, high = sorted(START_NS + rng.integers(-5, 405, 2) * 10_000_000)
            keys = {key for key in KEYS if rng.random() < 0.5}
            part = [s for s in samples if low <= s.received_ns < high and s.key in keys]
            assert told(log.records(low, high, keys.__contains__)) == expected(part)


def test_a_clock_that_goes_back_changes_no_order(tmp_path) -> None:
    samples = [
        Sample("target/pose", bytes([index]), START_NS + (5 - index) * 1000, None)
        for index in range(5)
    ]
    write(tmp_path / "a.mcap", samples)
    with RecordedLog(tmp_path / "a.mcap") as log:
        assert [record.payload[0] for record in log] == [0, 1, 2, 3, 4]
        times = [record.log_ns for record in log]
        assert times == sorted(times)


def test_senders_time_and_counter_are_kept(tmp_path) -> None:
    envelope = Envelope(seq=2**32 + 7, src="camera/3", boot="b", t_pub_ns=START_NS - 5)
    payload = encode(EXAMPLES["camera_pose"][1], envelope).join()
    stamped = Sample("cams/3/pose", payload, START_NS, START_NS - 9)
    write(tmp_path / "a.mcap", [Sample("cams/3/pose", payload, START_NS, None), stamped])
    with RecordedLog(tmp_path / "a.mcap") as log:
        first, second = log
    assert (first.sequence, first.publish_ns) == (7, START_NS - 5)
    assert second.publish_ns == START_NS - 9


def test_a_file_cut_anywhere_opens_and_has_a_prefix_of_what_was_written(
    tmp_path, samples, rng
) -> None:
    whole, cut = tmp_path / "a.mcap", tmp_path / "cut.mcap"
    write(whole, samples, flush_every=20)
    data = whole.read_bytes()
    lengths = sorted(rng.integers(200, len(data), 40))
    seen = []
    for length in lengths:
        cut.write_bytes(data[:length])
        with RecordedLog(cut) as log:
            got = told(log)
            assert got == expected(samples)[: len(got)]
            assert len(log) == len(got)
            assert len(log.lost) == 1
            seen.append(len(got))
    assert seen == sorted(seen)
    assert seen[-1] >= len(samples) - 41


def test_much_data_is_few_chunks_so_that_hours_are_closed_within_seconds(tmp_path) -> None:
    writer = LogWriter(tmp_path / "a.mcap", {})
    for index in range(64):
        writer.write(Sample("cams/0/cloud", bytes(1 << 19), index, None))
    writer.close({})
    with RecordedLog(tmp_path / "a.mcap") as log:
        assert len(log._chunks) <= 4  # Of 32 MiB.


def test_a_recorder_that_never_ended_loses_what_came_after_its_last_flush(
    tmp_path, samples
) -> None:
    log = write(tmp_path / "a.mcap", samples[:300], close=False)
    log.flush()
    for sample in samples[300:310]:
        log.write(sample)
    with pytest.raises(McapError):  # As plain indexed readers do.
        list(make_reader((tmp_path / "a.mcap").open("rb")).iter_messages())
    with RecordedLog(tmp_path / "a.mcap") as left:
        assert told(left) == expected(samples[:300])
        assert "killed" in left.lost[0]
        assert left.metadata["settings"] == {"rate": "15"}
        assert "end" not in left.metadata


def test_a_damaged_chunk_is_told_and_the_rest_is_read(tmp_path, samples) -> None:
    path = tmp_path / "a.mcap"
    write(path, samples, flush_every=100)
    with RecordedLog(path) as log:
        place = log._chunks[1]
    data = bytearray(path.read_bytes())
    middle = place.offset + place.length // 2
    data[middle : middle + 8] = bytes(byte ^ 0xFF for byte in data[middle : middle + 8])
    path.write_bytes(data)
    with RecordedLog(path) as log:
        got = told(log)
        assert set(got) < set(expected(samples))
        assert got == [sample for sample in expected(samples) if sample in got]
        assert len(got) >= len(samples) - 101
        assert ["damaged" in sentence for sentence in log.lost] == [True]


def test_random_damage_never_does_worse_than_say_so(tmp_path, samples, rng) -> None:
    path = tmp_path / "a.mcap"
    write(path, samples[:100], flush_every=20)
    whole, truth = path.read_bytes(), set(expected(samples[:100]))
    for _ in range(150):
        data = bytearray(whole[: rng.integers(8, len(whole) + 1)])
        for at in rng.integers(0, len(data), rng.integers(1, 6)):
            data[at] = rng.integers(256)
        path.write_bytes(data)
        try:
            with RecordedLog(path) as log:
                got = {(key, payload) for key, payload, _ in told(log)}
        except BadRecording:
            continue
        # Records are told as they were: a key may be damaged in the summary, a payload never.
        assert {payload for _, payload in got} <= {payload for _, payload, _ in truth}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty: no MCAP file"),
        (b"garbage of some length, no recording", "no MCAP file"),
        (b"\x89MCAP0\r\n", "no MCAP header"),
        (b"\x89MCAP0\r\n" + bytes(64), "no MCAP header"),
        (b"\x89MCAP0\r\n\x01" + b"\xff" * 40, "no MCAP header"),
    ],
)
def test_what_is_no_recording_is_refused_by_name(tmp_path, content: bytes, says: str) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(BadRecording, match=says):
        RecordedLog(tmp_path / "x.mcap")


def test_a_recording_of_others_is_refused_by_name(tmp_path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "x.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "rosbag2")
        writer.finish()
    with pytest.raises(BadRecording, match="profile 'ros2', written by 'rosbag2'"):
        RecordedLog(tmp_path / "x.mcap")


def test_a_folder_and_a_missing_file_are_named(tmp_path) -> None:
    with pytest.raises(BadRecording, match="is a folder"):
        RecordedLog(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"nothing\.mcap"):
        RecordedLog(tmp_path / "nothing.mcap")


def test_a_file_that_is_there_is_not_overwritten_unasked(tmp_path, samples) -> None:
    path = tmp_path / "a.mcap"
    write(path, samples)
    before = path.read_bytes()
    with pytest.raises(CannotRecord, match="exists"):
        LogWriter(path, {})
    assert path.read_bytes() == before
    LogWriter(path, {}, overwrite=True).close({})
    with RecordedLog(path) as log:
        assert list(log) == []


def test_a_path_that_cannot_be_written_is_named(tmp_path) -> None:
    with pytest.raises(CannotRecord, match="No such file or directory"):
        LogWriter(tmp_path / "nowhere" / "a.mcap", {})


def test_mcaps_own_reader_reads_it_with_schemas(tmp_path) -> None:
    payload = encode(
        EXAMPLES["camera_pose"][1], Envelope(seq=1, src="camera/3", boot="b", t_pub_ns=1)
    ).join()
    write(tmp_path / "a.mcap", [Sample("cams/3/pose", payload, START_NS, None)])
    with (tmp_path / "a.mcap").open("rb") as file:
        ((schema, channel, message),) = make_reader(file, validate_crcs=True).iter_messages()
    assert (schema.name, schema.encoding) == ("encircle.CameraPose", "jsonschema")
    assert (channel.topic, channel.message_encoding) == ("cams/3/pose", "msgpack")
    properties = {name for part in json.loads(schema.data)["allOf"] for name in part["properties"]}
    assert properties == set(msgpack.unpackb(message.data))


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.key)
def test_every_topic_has_a_schema_whose_references_lead_somewhere(topic) -> None:
    schema = json.loads(json_schema(topic))

    def references(node):
        if isinstance(node, dict):
            yield from (value for key, value in node.items() if key == "$ref")
            for value in node.values():
                yield from references(value)
        elif isinstance(node, list):
            for value in node:
                yield from references(value)

    assert {ref.removeprefix("#/$defs/") for ref in references(schema)} <= set(schema["$defs"])
