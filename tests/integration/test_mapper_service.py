"""A mapper on a real bus: an instant of clouds in; changes, summary and snapshot out."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from schemas.cloud import XyzCloud
from schemas.geometry import Pose, Twist
from schemas.target import TargetPose
from schemas.topics import (
    CAMERA_CLOUD,
    CLOUD_HEARD,
    MAP_FULL,
    TARGET_POSE,
)
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.map_mirror import MapMirror, Outcome
from tests.integration.mapper_world import (
    WAIT_S,
    World,
    camera_pose,
    cloud,
    expected_map,
    target_pose,
    worlds,
)

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


@pytest.fixture
def start(open_bus: OpenBus) -> Iterator[Callable[..., World]]:
    with worlds(open_bus) as begin:
        yield begin


def test_an_instant_becomes_the_map_of_its_clouds_in_the_targets_frame(start) -> None:
    world = start()
    mirror = MapMirror()
    for tick in range(4):
        changes, summary = world.instant(tick, 2, 0, 1)
        assert mirror.apply(changes) is Outcome.APPLIED
        expected = expected_map(tick, (0, 1, 2))
        assert len(mirror) == expected.counts().occupied
        assert (expected.classify(mirror.centres()) == 2).all()
        np.testing.assert_allclose(changes.pose.matrix(), target_pose(tick), atol=1e-9)
        assert (summary.tick, summary.rev, changes.rev) == (tick, tick + 1, tick + 1)
        assert summary.cameras_used == (0, 1, 2)
        assert summary.cameras_missing == ()
        counts = expected.counts()
        assert (summary.num_free, summary.num_occupied) == (counts.free, counts.occupied)
        assert summary.num_returns == 3 * 48 * 64
        assert summary.latency_ms >= summary.fuse_ms


def test_clouds_wait_for_the_pose_of_their_tick(start) -> None:
    world = start()
    world.instant(0, 0, 1, 2)
    world.send(1, 0, 1, 2)
    with pytest.raises(TimeoutError):
        world.changes.get(0.2)
    world.tell_target(1)
    changes, _ = world.answer()
    np.testing.assert_allclose(changes.pose.matrix(), target_pose(1), atol=1e-9)


def test_a_pose_told_twice_is_answered_twice_and_a_cloud_told_twice_is_not_late(start) -> None:
    world = start()
    told = world.instant(0, 0, 1, 2)
    world.send(0, 1)
    world.tell_target(0)
    assert world.answer() == told
    assert world.instant(1, 0, 1, 2)[1].late_clouds == 0


def test_plausible_messages_of_absurd_values_are_counted_and_change_nothing(
    start, open_bus: OpenBus
) -> None:
    world = start(deadline_s=1.0)
    world.instant(0, 0, 1, 2)
    open_bus("camera", "100", announce=True)  # An index that no message may have.
    absurd = cloud(1, 1).model_copy(update={"tick": 2**62})
    world.cameras[1].publish(CAMERA_CLOUD, absurd, camera=1)
    elsewhere = cloud(1, 1).model_copy(update={"frame_id": "odom"})
    world.cameras[1].publish(CAMERA_CLOUD, elsewhere, camera=1)
    foreign = TargetPose(
        t_ns=0,
        tick=1,
        frame_id="odom",
        pose=Pose.from_matrix(np.eye(4)),
        twist=Twist(linear=(0, 0, 0), angular=(0, 0, 0)),
    )
    world.bus.publish(TARGET_POSE, foreign)
    changes, summary = world.instant(1, 0, 1, 2)
    assert summary.cameras_used == (0, 1, 2)
    assert summary.cameras_missing == ()
    np.testing.assert_allclose(changes.pose.matrix(), target_pose(1), atol=1e-9)


def test_the_deadline_closes_an_instant_and_names_who_is_missing(start) -> None:
    world = start(deadline_s=0.3)
    _, summary = world.instant(0, 0, 2)
    assert (summary.cameras_used, summary.cameras_missing) == ((0, 2), (1,))
    expected = expected_map(0, (0, 2)).counts()
    assert summary.num_occupied == expected.occupied


def test_a_camera_that_dies_is_not_waited_for(start) -> None:
    world = start(deadline_s=30.0)
    world.instant(0, 0, 1, 2)
    world.cameras[1].close()
    _, summary = world.instant(1, 0, 2)
    assert summary.cameras_used == (0, 2)


def test_a_snapshot_taken_in_the_middle_of_an_instant_is_that_of_the_last_changes(start) -> None:
    world = start(deadline_s=30.0)
    mirror = MapMirror()
    mirror.apply(world.instant(0, 0, 1, 2)[0])
    world.tell_target(1)
    world.send(1, 0)
    until = time.monotonic() + WAIT_S
    while world.bus.request("mapper", "get")["occupied"] == len(mirror):
        assert time.monotonic() < until, "the first cloud was never fused"
    healed = MapMirror()
    healed.reset(world.bus.fetch(MAP_FULL))
    np.testing.assert_array_equal(healed.voxels, mirror.voxels)
    world.send(1, 1, 2)
    changes, _ = world.answer()
    for each in (healed, mirror):
        assert each.apply(changes) is Outcome.APPLIED
    np.testing.assert_array_equal(healed.voxels, mirror.voxels)


def test_points_are_fused_as_rays(start) -> None:
    world = start(cameras=1, frame="world")
    points = np.array([[0.0, 0.0, 1.1], [np.nan, 0, 0]], np.float32)
    message = XyzCloud.of(
        points,
        t_ns=0,
        tick=0,
        frame_id="world",
        camera=0,
        pose=Pose.from_matrix(camera_pose(0)),
        max_range_m=5.0,
        t_capture_ns=time.time_ns(),
    )
    world.cameras[0].publish(CAMERA_CLOUD, message, camera=0)
    changes, summary = world.answer()
    assert (summary.num_occupied, summary.num_returns) == (1, 1)
    assert changes.frame_id == "world"


def test_realtime_goes_on_after_the_shorter_deadline(start) -> None:
    world = start(deadline_s=30.0, realtime_deadline_s=0.5)
    world.tell_mode("realtime")
    world.instant(0, 0, 1, 2)
    _, summary = world.instant(1, 0, 1)
    assert summary.cameras_missing == (2,)


def test_every_cloud_is_acknowledged_but_in_lockstep(start) -> None:
    world = start()
    with world.bus.every(CLOUD_HEARD) as heard:
        until_s = time.monotonic() + WAIT_S
        while not world.mapper.matching(CLOUD_HEARD, 0):
            assert time.monotonic() < until_s
        world.instant(0, 0, 1, 2)
        told = [heard.get(WAIT_S).message for _ in range(3)]
        assert sorted((each.camera, each.tick) for each in told) == [(0, 0), (1, 0), (2, 0)]
        world.tell_mode("lockstep")
        for tick in range(1, 20):
            world.instant(tick, 0, 1, 2)
            try:
                heard.get(0.3)
            except TimeoutError:
                return
    pytest.fail("in lockstep, too")
