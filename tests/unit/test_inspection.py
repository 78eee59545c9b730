"""What is said of messages and keys: short, true, and never an array's contents."""

import json

import msgpack
import numpy as np
import pytest

from schemas.cloud import DepthCloud
from schemas.codec import encode
from schemas.topics import TOPICS, find
from services.inspector.decoder import decode_line
from services.inspector.description import describe
from services.inspector.errors import UnknownField
from services.inspector.expressions import meets, nearest, rows_of
from services.inspector.plain import as_json, select, split_field, text
from services.inspector.schema_words import kinds, schema_lines
from tests.examples import ENVELOPE, EXAMPLES

pytestmark = pytest.mark.unit


def key_and_payload(name):
    topic, message = EXAMPLES[name]
    camera = getattr(message, "camera", None) if "{camera}" in topic.key else None
    key = topic.key_for(camera, "camera/3" if "{service}" in topic.key else None)
    return key, encode(message, ENVELOPE).join()


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_message_is_told_in_one_readable_line(name):
    key, payload = key_and_payload(name)
    line = decode_line(key, payload)
    assert line.startswith(f"{key}  #41  tick ")
    assert "\n" not in line
    assert len(line) < 300
    assert line.isprintable()


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_message_can_be_said_in_json(name):
    said = describe(*key_and_payload(name))
    assert json.loads(as_json(said.fields))["seq"] == 41
    assert all(line for line in text(said.fields, 8))


def test_a_large_cloud_is_summarised():
    depth = np.zeros((480, 640), np.uint16)
    depth[:240] = 1500
    depth[0, 0], depth[479] = 700, 65535
    example = EXAMPLES["depth_cloud"][1]
    optics = example.intrinsics.model_copy(update={"width": 640, "height": 480})
    fields = {name: getattr(example, name) for name in DepthCloud.model_fields}
    for own in ("data", "shape", "dtype"):
        del fields[own]
    cloud = DepthCloud.of(depth, **{**fields, "intrinsics": optics, "depth_scale_m": 0.001})
    said = describe("cams/3/cloud", encode(cloud, ENVELOPE).join())
    assert "depth 640 x 480, 50.0% returned from 0.7 to 1.5 m, 0.2% looked at nothing" in said.line
    assert len("\n".join(text(said.fields, None))) < 1000


def test_what_services_refuse_is_told_with_the_reason():
    key, payload = key_and_payload("camera_pose")
    assert "refused by all services: camera is 3; the key says 5" in decode_line(
        "cams/5/pose", payload
    )
    assert "refused by all services" in decode_line(key, payload[:40])


def test_foreign_keys_are_told_as_far_as_they_can_be():
    packed = msgpack.packb({"speed": 3, "list": [1, 2]})
    assert decode_line("other/key", packed) == "other/key  not in the topic table: speed, list"
    assert "3 B: ff 00 01" in decode_line("other/key", b"\xff\x00\x01")
    assert describe("other/key", packed).fields == {"fields": {"speed": 3, "list": [1, 2]}}


@pytest.mark.parametrize("seed", range(10))
def test_no_bytes_can_end_the_decoder(seed):
    rng = np.random.default_rng(seed)
    for topic in TOPICS:
        key = topic.key.format(camera=0, service="mapper")
        assert decode_line(key, rng.bytes(rng.integers(0, 300))).isprintable()


def test_a_field_is_chosen_by_its_path():
    fields = describe(*key_and_payload("formation")).fields
    assert select(fields, "radius_m") == fields["radius_m"]
    assert (
        select(fields, "references[0].pose.position[2]")
        == (fields["references"][0]["pose"]["position"][2])
    )
    assert select(fields, "references.0.camera") == fields["references"][0]["camera"]
    assert select(fields, "") == fields


@pytest.mark.parametrize(
    ("path", "complaint"),
    [
        ("radius", r"field 'radius': no 'radius'; known: v, seq, src.*radius_m"),
        ("centre.x", r"no 'x' of centre; known: 0 to 2"),
        ("centre[3]", r"no '3' of centre; known: 0 to 2"),
        ("radius_m.x", r"no 'x' of radius_m; known: nothing, it is a single value"),
        ("a[", "write it like"),
    ],
)
def test_a_wrong_field_is_answered_with_the_right_ones(path, complaint):
    fields = describe(*key_and_payload("formation")).fields
    if path == "a[":
        fields = {"a": 1}
    with pytest.raises(UnknownField, match=complaint):
        select(fields, path)


def test_keys_and_fields_are_parted_at_the_first_dot():
    assert split_field("formation.radius_m") == ("formation", "radius_m")
    assert split_field("cams/*/pose.pose.position") == ("cams/*/pose", "pose.position")
    assert split_field("cams/0/pose") == ("cams/0/pose", "")


def test_long_lists_are_cut_and_say_so():
    assert text({"a": list(range(20))}, 3) == ["a: [0, 1, 2, ... 17 more]"]
    assert text([{"b": 1}, {"b": 2}], 1) == ["- b: 1", "... 1 more (--full shows all)"]


@pytest.mark.parametrize(
    ("one", "other", "common"),
    [
        ("cams/*/pose", "cams/0/pose", True),
        ("cams/*/pose", "cams/0/cloud", False),
        ("cams/**", "cams/0/cloud", True),
        ("**", "formation", True),
        ("**/pose", "cams/*/pose", True),
        ("*", "cams/0", False),
        ("metrics/**", "metrics/camera/*", True),
        ("cams/$*1/pose", "cams/11/pose", True),
        ("cams/$*1/pose", "cams/12/pose", False),
        ("formation", "formation/**", True),
    ],
)
def test_expressions_meet_as_zenoh_says(one, other, common):
    import zenoh

    assert meets(one, other) == meets(other, one) == common
    assert zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other)) == common


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.key)
def test_a_key_means_its_row_and_a_wildcard_all_of_a_kind(topic):
    key = topic.key.format(camera=2, service="camera/2")
    assert rows_of(key) == (topic,)
    assert topic in rows_of("**")
    assert topic in rows_of(topic.expression())


def test_a_slip_of_the_pen_is_understood():
    assert nearest("cams/4/poze") == "cams/4/pose"
    assert nearest("formatoin") == "formation"
    assert nearest("zzzzzzzz") is None


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.key)
def test_every_field_of_every_message_is_explained(topic):
    lines = schema_lines(topic.message)
    for kind in kinds(topic.message):
        for name in kind.model_fields:
            assert any(line.strip().startswith(f"{name}: ") for line in lines)
    assert any(line.startswith("seq: ") and "a gap is a lost message" in line for line in lines)


def test_both_kinds_of_cloud_are_told():
    row = find("cams/0/cloud")
    assert [kind.__name__ for kind in kinds(row.message)] == ["DepthCloud", "XyzCloud"]
