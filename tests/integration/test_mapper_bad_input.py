"""Clouds and poses that cannot be: refused, counted, shown, and the map is as it was."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from schemas.cloud import DepthCloud
from schemas.geometry import Pose, Twist
from schemas.message import Message
from schemas.target import TargetPose
from schemas.topics import CAMERA_CLOUD, MAP_FULL, SERVICE_STATUS, TARGET_POSE, Topic
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from tests.integration.mapper_world import DT_NS, WAIT_S, World, cloud, target_pose, worlds

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


@pytest.fixture
def world(open_bus: OpenBus) -> Iterator[World]:
    """A mapper that has fused an instant of two cameras and keeps it."""
    with worlds(open_bus) as begin:
        made = begin(cameras=2, memory="persistent", deadline_s=0.3)
        made.instant(0, 0, 1)
        yield made


def spoilt(message: Message, **wrong: Any) -> Message:
    """The message with wrong fields, which nobody has validated."""
    fields = {name: getattr(message, name) for name in type(message).model_fields}
    return type(message).model_construct(**{**fields, **wrong})


def pose(position: tuple[float, ...], orientation: tuple[float, ...]) -> Pose:
    return Pose.model_construct(position=position, orientation=orientation)


def optics(**wrong: Any) -> Any:
    made = cloud(1, 1).intrinsics
    return type(made).model_construct(**{**made.model_dump(), **wrong})


def refused(world: World, key: str) -> int:
    return sum(meter.bad for meter in world.mapper.meters if meter.key == key)


def send_refused(world: World, topic: Topic[Any], message: Message, camera: int | None) -> None:
    """Publish what must be refused, and wait until it is."""
    key, bus = topic.key_for(camera), world.bus if camera is None else world.cameras[camera]
    before, until = refused(world, key), time.monotonic() + WAIT_S
    bus.publish(topic, message, camera=camera)
    while refused(world, key) == before:
        assert time.monotonic() < until, "it was not refused"


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"pose": pose((0, 0, 0), (0, 0, 0, 2))}, "norm 2; it must be 1"),
    ({"pose": pose((0, 0, 0), (0, 0, 0, 0))}, "norm 0; it must be 1"),
    ({"pose": pose((math.nan, 0, 0), (0, 0, 0, 1))}, "finite"),
    ({"pose": pose((1e30, 0, 0), (0, 0, 0, 1))}, "less than or equal to 1000000"),
    ({"intrinsics": optics(width=32)}, r"shape (48, 64) must be (height, width) = (48, 32)"),
    ({"intrinsics": optics(fx=0.0)}, "greater than 0"),
    ({"intrinsics": optics(fx=1e-9)}, "fx 1e-09"),
    ({"shape": (48, 65)}, "needs 6240 bytes, got 6144"),
    ({"shape": (8193, 8192)}, "exceeds the limit"),
    ({"dtype": "<f4"}, "must be '<u2'"),
    ({"depth_scale_m": 0.0}, "greater than or equal to"),
    ({"depth_scale_m": 1e30}, "less than or equal to 1"),
    ({"max_range_m": math.inf}, "finite"),
    ({"max_range_m": 0.0}, "greater than 0"),
    ({"tick": -1}, "greater than or equal to 0"),
]


@pytest.mark.filterwarnings("ignore:Pydantic serializer warnings")
def test_wrong_clouds_are_refused(world: World) -> None:
    before = world.bus.fetch(MAP_FULL).array.tobytes()
    world.tell_target(1)
    for count, (wrong, says) in enumerate(WRONG, start=1):
        send_refused(world, CAMERA_CLOUD, spoilt(cloud(1, 1), **wrong), camera=1)
        assert says in world.mapper.last_refusal
        assert refused(world, "cams/1/cloud") == count
        assert world.bus.fetch(MAP_FULL).array.tobytes() == before
    # One that was refused late had an instant of its own, and closed the next without the other.
    tick, until = 2, time.monotonic() + 3 * WAIT_S
    while (summary := world.instant(tick, 0, 1)[1]).cameras_used != (0, 1):
        assert time.monotonic() < until, "the mapper does not go on"
        tick += 1
    assert summary.num_occupied > 0


def test_a_target_that_is_turned_by_no_rotation_moves_nothing(world: World) -> None:
    before = world.bus.fetch(MAP_FULL)
    still = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
    stamp = {"t_ns": DT_NS, "tick": 1, "frame_id": "world"}
    told = TargetPose(**stamp, pose=Pose.from_matrix(target_pose(1)), twist=still)
    for orientation in ((0, 0, 0, 2), (math.nan, 0, 0, 1)):
        wrong = spoilt(told, pose=pose((0, 0, 0), orientation))
        send_refused(world, TARGET_POSE, wrong, camera=None)
    after = world.bus.fetch(MAP_FULL)
    assert after.array.tobytes() == before.array.tobytes()
    assert after.pose == before.pose
    changes, _ = world.instant(1, 0, 1)
    np.testing.assert_allclose(changes.pose.matrix(), target_pose(1), atol=1e-9)


def test_what_was_refused_is_shown_with_its_reason(world: World) -> None:
    with world.bus.every(SERVICE_STATUS) as statuses:
        short: DepthCloud = cloud(1, 1)
        wrong = spoilt(short, pose=pose((0, 0, 0), (0, 0, 0, 2)))
        for count in range(1, 4):
            send_refused(world, CAMERA_CLOUD, wrong, camera=1)
            assert refused(world, "cams/1/cloud") == count
        with pytest.raises(Exception, match="greater than 0"):
            world.bus.request("mapper", "set", {"half_life_s": 0.0})
        until = time.monotonic() + WAIT_S
        while (status := statuses.get(WAIT_S).message).bad_messages < 4:
            assert time.monotonic() < until, "the heartbeat never told"
    assert status.service == "mapper"
    assert "half_life_s" in status.bad_reason
    bad = {topic.key: topic.bad for topic in status.topics if topic.bad}
    assert bad == {"cams/1/cloud": 3, "ctl/mapper/set": 1}
