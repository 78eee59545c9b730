"""Bytes and messages: laws over every message, and the bytes of the past."""

import tracemalloc
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.codec import MAX_PAYLOAD_BYTES, decode, encode, unpack
from schemas.message import ArrayMessage, Envelope, MessageError
from schemas.topics import CAMERA_CLOUD, TOPICS
from tests.examples import ENVELOPE, EXAMPLES

pytestmark = pytest.mark.unit

GOLDEN = Path(__file__).parent / "golden"
NAMES = sorted(EXAMPLES)
ARRAY_NAMES = [name for name in NAMES if isinstance(EXAMPLES[name][1], ArrayMessage)]


def payload_of(name: str) -> bytes:
    return encode(EXAMPLES[name][1], ENVELOPE).join()


def test_every_topic_has_an_example() -> None:
    assert {topic.key for topic, _ in EXAMPLES.values()} == {topic.key for topic in TOPICS}


@pytest.mark.parametrize("name", NAMES)
def test_what_is_encoded_decodes_to_the_same(name: str) -> None:
    topic, message = EXAMPLES[name]
    envelope, decoded = decode(topic.adapter, payload_of(name))
    assert envelope == ENVELOPE
    assert decoded == message


@pytest.mark.parametrize("name", NAMES)
def test_the_bytes_of_the_past_still_decode(name: str) -> None:
    topic, message = EXAMPLES[name]
    golden = (GOLDEN / f"{name}.msgpack").read_bytes()
    assert decode(topic.adapter, golden) == (ENVELOPE, message)


@pytest.mark.parametrize("name", NAMES)
def test_any_msgpack_library_reads_the_payload_as_one_map(name: str) -> None:
    fields = msgpack.unpackb(payload_of(name))
    assert fields["v"] == 1
    assert fields["tick"] == EXAMPLES[name][1].tick
    if name in ARRAY_NAMES:
        assert list(fields)[-1] == "data"
        assert fields["data"] == bytes(EXAMPLES[name][1].data)


@pytest.mark.parametrize("name", NAMES)
def test_a_plain_msgpack_writer_in_any_key_order_is_understood(name: str) -> None:
    topic, message = EXAMPLES[name]
    fields = msgpack.unpackb(payload_of(name))
    shuffled = dict(sorted(fields.items()))  # `data` is not last any more.
    assert decode(topic.adapter, msgpack.packb(shuffled))[1] == message


@pytest.mark.parametrize("name", NAMES)
def test_unknown_fields_are_ignored(name: str) -> None:
    topic, message = EXAMPLES[name]
    fields = {"from_the_future": [1, 2]} | msgpack.unpackb(payload_of(name))
    assert decode(topic.adapter, msgpack.packb(fields))[1] == message


@pytest.mark.parametrize("name", NAMES)
def test_every_truncation_is_a_message_error(name: str) -> None:
    topic, _ = EXAMPLES[name]
    payload = payload_of(name)
    for length in range(len(payload)):
        with pytest.raises(MessageError):
            decode(topic.adapter, payload[:length])


@pytest.mark.parametrize("name", NAMES)
def test_trailing_bytes_are_a_message_error(name: str) -> None:
    with pytest.raises(MessageError):
        decode(EXAMPLES[name][0].adapter, payload_of(name) + b"\0")


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_field_is_named(name: str) -> None:
    topic, message = EXAMPLES[name]
    fields = msgpack.unpackb(payload_of(name))
    for field, info in type(message).model_fields.items():
        if info.is_required():
            without = {key: value for key, value in fields.items() if key != field}
            with pytest.raises(MessageError, match=field):
                decode(topic.adapter, msgpack.packb(without))


@pytest.mark.parametrize("name", ARRAY_NAMES)
@pytest.mark.parametrize(
    "wrong",
    [
        {"dtype": "<f8"},
        {"dtype": "object"},
        {"dtype": "|O"},
        {"shape": [1]},
        {"shape": [-1, 4]},
        {"shape": [2**31 - 1, 4]},
        {"shape": [2**40, 2**40]},
        {"shape": []},
        {"shape": "3x4"},
        {"data": b""},
        {"data": b"\0" * 7},
        {"data": "text"},
        {"data": [1, 2]},
        {"data": None},
    ],
)
def test_a_wrong_dtype_shape_or_size_is_a_message_error(name: str, wrong: dict) -> None:
    topic, _ = EXAMPLES[name]
    fields = msgpack.unpackb(payload_of(name)) | wrong
    with pytest.raises(MessageError):
        decode(topic.adapter, msgpack.packb(fields))


@pytest.mark.parametrize("version", [0, 2, "1x", None])
def test_another_schema_version_is_a_message_error(version: object) -> None:
    fields = msgpack.unpackb(payload_of("target_pose")) | {"v": version}
    with pytest.raises(MessageError, match="v"):
        decode(EXAMPLES["target_pose"][0].adapter, msgpack.packb(fields))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf"), 1e9])
def test_numbers_that_no_scene_has_are_a_message_error(bad: float) -> None:
    fields = msgpack.unpackb(payload_of("target_pose"))
    fields["pose"]["position"][1] = bad
    with pytest.raises(MessageError, match=r"pose\.position\.1"):
        decode(EXAMPLES["target_pose"][0].adapter, msgpack.packb(fields))


def test_a_quaternion_that_is_not_unit_is_refused_with_its_norm() -> None:
    fields = msgpack.unpackb(payload_of("target_pose"))
    fields["pose"]["orientation"] = [0, 0, 0, 2]
    with pytest.raises(MessageError, match="norm 2"):
        decode(EXAMPLES["target_pose"][0].adapter, msgpack.packb(fields))


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(NAMES), st.binary(max_size=300))
def test_noise_is_a_message_error(name: str, noise: bytes) -> None:
    with pytest.raises(MessageError):
        decode(EXAMPLES[name][0].adapter, noise)


@settings(max_examples=1500, deadline=None)
@given(st.sampled_from(NAMES), st.data())
def test_flipped_bytes_decode_or_raise_a_message_error(name: str, data: st.DataObject) -> None:
    payload = bytearray(payload_of(name))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        envelope, _ = decode(EXAMPLES[name][0].adapter, bytes(payload))
    except MessageError:
        return
    assert isinstance(envelope, Envelope)


@pytest.mark.parametrize(
    "bomb",
    [
        b"\xdd\xff\xff\xff\xff" * 200_000,  # Arrays within arrays, each claiming 4 G items.
        b"\xdd\x00\x10\x00\x00" * 200_000,
        b"\x81\xa4data\xc6\xff\xff\xff\xff" + b"x" * 100,
        b"\x81\xa5shape\xc6\xff\xff\xff\xf0",
        b"\xdf\xff\xff\xff\xff" * 1000,
        b"\x91" * 100_000,
        b"\x81\xa1x\xc9\xff\xff\xff\xff\x01",
    ],
)
def test_no_payload_makes_us_allocate_far_beyond_its_size(bomb: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(MessageError):
            decode(CAMERA_CLOUD.adapter, bomb)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 32 << 20


def test_a_payload_above_the_bound_is_refused_unread() -> None:
    class Long(bytes):
        def __len__(self) -> int:
            return MAX_PAYLOAD_BYTES + 1

    with pytest.raises(MessageError, match="exceeds"):
        unpack(Long())


def test_a_decoded_array_is_a_view_of_the_payload() -> None:
    payload = payload_of("depth_cloud")
    _, cloud = decode(CAMERA_CLOUD.adapter, payload)
    assert np.shares_memory(cloud.array, np.frombuffer(payload, np.uint8))


def test_an_array_over_a_bytearray_is_sent_without_a_copy() -> None:
    buffer = bytearray(24)
    image = np.frombuffer(buffer, "<u2").reshape(3, 4)
    example = EXAMPLES["depth_cloud"][1]
    cloud = type(example).of(image, **example.model_dump(exclude={"shape", "dtype", "data"}))
    assert encode(cloud, ENVELOPE).body is buffer
