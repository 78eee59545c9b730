"""The topic table finds its own keys and no others."""

import pytest

from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_POSE,
    MAP_CHANGES,
    QUALITY,
    SERVICE_STATUS,
    TARGET_POSE,
    TOPICS,
    camera_of,
    find,
)

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.key)
def test_a_concrete_key_finds_its_row(topic) -> None:
    camera = 5 if "{camera}" in topic.key else None
    service = "camera/5" if "{service}" in topic.key else None
    key = topic.key_for(camera, service)
    assert find(key) is topic
    assert camera_of(key) == camera


def test_quality_is_not_taken_for_a_service() -> None:
    assert find("metrics/quality") is QUALITY
    assert find("metrics/mapper") is SERVICE_STATUS
    assert find("metrics/camera/3") is SERVICE_STATUS


@pytest.mark.parametrize(
    "key",
    [
        "cams/x/pose",
        "cams/3",
        "cams/3/pose/x",
        "map",
        "",
        "metrics",
        "metrics/a/b/c",
        "cams/64/pose",
        "cams/007/pose",
        "metrics/" + "x" * 300,
    ],
)
def test_a_strange_key_finds_nothing(key: str) -> None:
    assert find(key) is None


@pytest.mark.parametrize("camera", [None, -1, 64, 1000])
def test_a_camera_index_out_of_range_is_named(camera: int | None) -> None:
    with pytest.raises(ValueError, match=r"cams/\{camera\}/pose: camera"):
        CAMERA_POSE.key_for(camera)


def test_an_index_for_a_key_without_one_is_refused() -> None:
    with pytest.raises(ValueError, match="target/pose"):
        TARGET_POSE.key_for(3)


def test_large_streams_and_no_others_go_by_shared_memory() -> None:
    large = {topic.key for topic in TOPICS if topic.shared_memory}
    assert large >= {CAMERA_CLOUD.key, MAP_CHANGES.key}
    assert CAMERA_POSE.key not in large
