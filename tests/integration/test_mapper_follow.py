"""A mapper whose box follows the target through the world, on a real bus."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from schemas.geometry import Pose, Twist
from schemas.target import TargetPose
from schemas.topics import MAP_FULL, TARGET_POSE
from services.mapper.settings import MapperSettings
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.map_mirror import MapMirror, Outcome
from tests.integration.mapper_world import (
    DT_NS,
    INTRINSICS,
    World,
    camera_pose,
    depth_of,
    target_pose,
    worlds,
)

pytestmark = pytest.mark.integration

FOLLOWING = {"frame": "world", "follow": "target", "memory": "persistent"}
MIDDLE_M = np.array((0.0, 0.0, 0.3))
"""Of the box, from the target."""
TICKS = 16
"""In which the target goes 1.5 m: farther than the box is wide."""


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


@pytest.fixture
def start(open_bus: Callable[..., Bus]) -> Iterator[Callable[..., World]]:
    with worlds(open_bus) as begin:
        yield begin


def fuse(voxel_map: VoxelMap, tick: int) -> None:
    """What a mapper does with an instant of two cameras."""
    T_world_target = target_pose(tick)
    voxel_map.move_to(T_world_target[:3, 3] + MIDDLE_M)
    k = INTRINSICS
    for camera in (0, 1):
        T_world_camera = Pose.from_matrix(T_world_target @ camera_pose(camera)).matrix()
        pinhole = (k.fx, k.fy, k.cx, k.cy)
        voxel_map.fuse_depth(depth_of(tick, camera), pinhole, T_world_camera, 0.001, 5.0)


@pytest.mark.parametrize("archive", [False, True])
def test_the_box_moves_with_the_target_and_mirrors_move_with_the_box(
    start, tmp_path, archive: bool
) -> None:
    world = start(cameras=2, archive=archive, files=tmp_path, **FOLLOWING)
    expected = MapperSettings(archive=archive, **FOLLOWING).empty_map()
    mirror, origins = MapMirror(), set()
    for tick in range(TICKS):
        changes, summary = world.instant(tick, 1, 0)
        fuse(expected, tick)
        assert mirror.apply(changes) is Outcome.APPLIED
        occupied = np.argwhere(expected.log_odds_dense() >= 0)
        np.testing.assert_array_equal(mirror.voxels, occupied)
        middle = np.array(summary.origin) + np.array(changes.shape_voxels) / 2 * 0.01
        assert (np.abs(middle - target_pose(tick)[:3, 3] - MIDDLE_M) < 0.09).all()
        assert summary.origin == changes.origin == pytest.approx(expected.box.origin_m)
        assert summary.archived_bricks == expected.num_archived
        origins.add(summary.origin)
    assert len(origins) > TICKS // 2
    assert (summary.archived_bricks > 0) == archive
    answer = world.bus.request("mapper", "get")
    assert (answer["follow"], answer["archived_bricks"]) == ("target", summary.archived_bricks)
    assert answer["origin_m"] == pytest.approx(summary.origin)
    healed = MapMirror()
    healed.reset(world.bus.fetch(MAP_FULL))
    np.testing.assert_array_equal(healed.voxels, mirror.voxels)
    saved_and_loaded(world, expected, mirror)


def saved_and_loaded(world: World, expected: VoxelMap, mirror: MapMirror) -> None:
    """A file brings window and archive back; the box stays where the target is."""
    world.bus.request("mapper", "save", {"path": "drive.npz"})
    world.bus.request("mapper", "reset")
    assert world.bus.request("mapper", "load", {"path": "drive.npz"})["shape"] == [120, 120, 80]
    changes, summary = world.instant(TICKS, 0, 1)
    fuse(expected, TICKS)
    assert mirror.apply(changes) is Outcome.APPLIED
    np.testing.assert_array_equal(mirror.voxels, np.argwhere(expected.log_odds_dense() >= 0))
    assert summary.archived_bricks == expected.num_archived


def test_a_target_that_is_nowhere_near_is_refused_and_the_box_stays(start) -> None:
    world = start(cameras=1, **FOLLOWING)
    _, before = world.instant(0, 0)
    far = TargetPose(
        t_ns=DT_NS,
        tick=1,
        frame_id="world",
        pose=Pose(position=(1e5, 0, 0), orientation=(0, 0, 0, 1)),
        twist=Twist(linear=(0, 0, 0), angular=(0, 0, 0)),
    )
    world.bus.publish(TARGET_POSE, far)
    world.send(1, 0)
    _, summary = world.answer()
    assert (summary.tick, summary.origin) == (1, before.origin)
    assert "within" in world.mapper.last_refusal
    _, summary = world.instant(2, 0)
    assert summary.origin != before.origin
