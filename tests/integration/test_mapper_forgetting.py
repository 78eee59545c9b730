"""What the mapper forgets and flags is what its core does, as settings and requests tell it."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from schemas.cloud import DepthCloud
from schemas.topics import CAMERA_CLOUD
from services.mapper.fusion import Fusion, MemorySettings
from services.mapper.settings import MapperSettings
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.map_mirror import MapMirror, Outcome
from tests.integration.mapper_world import DT_NS, World, cloud, target_pose, worlds

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


def passing(tick: int) -> DepthCloud:
    """Something that comes after ten instants, goes, and comes again."""
    depth = np.full((48, 64), 1350, np.uint16)
    if tick >= 10 and tick % 4 < 2:
        depth[12:30, 20:40] = 1100
    same = cloud(tick, 0).model_dump(exclude={"shape", "dtype", "data"})
    return DepthCloud.of(depth, **same)


@pytest.fixture
def start(open_bus: Callable[..., Bus]) -> Iterator[Callable[..., World]]:
    with worlds(open_bus) as begin:
        yield begin


def test_frames_half_life_and_flags_are_followed_and_can_be_changed_while_it_runs(start) -> None:
    told = {"memory": "persistent", "frames_to_clear": 1, "frames_to_appear": 1, "dynamic": True}
    world = start(cameras=1, voxel_size=0.04, **told)
    settings = MapperSettings(voxel_size=0.04, **told)
    alone = Fusion(settings.empty_map(), settings.memory_settings())
    mirror, num_dynamic = MapMirror(), []
    for tick in range(30):
        if tick == 20:
            changed = {"memory": "decay", "half_life_s": 0.2, "frames_to_clear": 3}
            assert world.bus.request("mapper", "set", changed)["frames_to_clear"] == 3
            alone.memory = MemorySettings(**{**alone.memory.model_dump(), **changed})
        alone.begin(tick * DT_NS, target_pose(tick))
        alone.fuse(passing(tick))
        alone.voxel_map.changes()
        world.tell_target(tick)
        world.cameras[0].publish(CAMERA_CLOUD, passing(tick), camera=0)
        changes, summary = world.answer()
        assert mirror.apply(changes) is Outcome.APPLIED
        assert (alone.voxel_map.classify(mirror.centres()) == 2).all()
        counts = alone.voxel_map.counts()
        assert (summary.num_occupied, summary.num_free) == (counts.occupied, counts.free)
        assert summary.num_dynamic == alone.voxel_map.num_dynamic
        num_dynamic.append(summary.num_dynamic)
    assert world.bus.request("mapper", "get")["num_dynamic"] == num_dynamic[-1]
    assert max(num_dynamic) > 20
    assert max(num_dynamic[:10]) == 0
