"""A mapper that is started again knows its map, or says that it begins empty."""

from pathlib import Path

import pytest

from schemas.topics import MAP_FULL
from services.mapper.service import MapperService
from services.mapper.settings import MapperSettings
from services.mapper.warm_up import warm_up
from services.runtime.loop import Loop
from services.runtime.map_mirror import MapMirror
from tests.integration.conftest import running
from tests.integration.mapper_world import OpenBus, worlds

pytestmark = pytest.mark.integration

KEEP = {"memory": "persistent", "voxel_size": 0.02, "snapshot_every_s": 0.05}


def live(open_bus: OpenBus, path: Path, num_instants: int, verb: str | None = None) -> dict:
    """Run a mapper for some instants, from its start to its end; return what it last held."""
    with worlds(open_bus) as begin:
        world = begin(**KEEP, snapshot=path)
        mirror = MapMirror()
        for tick in range(num_instants):
            mirror.apply(world.instant(tick, 0, 1, 2)[0])
        if num_instants:
            full = MapMirror()
            full.reset(world.bus.fetch(MAP_FULL))
            assert (full.voxels == mirror.voxels).all()  # Also what was restored was told.
        if verb is not None:
            world.bus.request("mapper", verb)
        held: dict = world.bus.request("mapper", "get")
        for camera in world.cameras:
            camera.close()
        return held


def known(held: dict) -> tuple[int, int]:
    return held["free"], held["occupied"]


def test_a_map_outlives_its_mapper(open_bus: OpenBus, tmp_path: Path, caplog) -> None:
    warm_up()
    caplog.set_level("INFO")
    path = tmp_path / "a.npz"
    before = live(open_bus, path, 3)
    assert "the map begins empty: no snapshot at" in caplog.text
    assert known(before)[1] > 0
    caplog.clear()
    assert known(live(open_bus, path, 0)) == known(before)
    assert f"the map is restored from {path}: {before['occupied']} occupied" in caplog.text
    assert "of tick 2, saved" in caplog.text
    live(open_bus, path, 1)  # What goes on is told from the restored map on.


def test_a_torn_snapshot_is_said_and_the_map_begins_empty(
    open_bus: OpenBus, tmp_path: Path, caplog
) -> None:
    path = tmp_path / "a.npz"
    live(open_bus, path, 2)
    path.write_bytes(path.read_bytes()[:-500])
    assert known(live(open_bus, path, 0)) == (0, 0)
    assert f"the map begins empty: snapshot {path} is refused" in caplog.text
    assert f"it is now {path}.refused" in caplog.text


def test_what_was_reset_does_not_come_back(open_bus: OpenBus, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert known(live(open_bus, path, 2, "reset")) == (0, 0)
    assert known(live(open_bus, path, 0)) == (0, 0)


def test_a_disk_that_takes_nothing_is_said_once_and_stops_nobody(
    open_bus: OpenBus, tmp_path: Path, caplog
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    bus = open_bus("mapper", "0")
    loop = Loop(bus)
    settings = MapperSettings(**KEEP, snapshot=folder / "a.npz")
    folder.rmdir()
    MapperService(settings, bus, loop)
    with running(loop), worlds(open_bus) as begin:
        world = begin(memory="persistent", voxel_size=0.02)  # Another, so that both hear.
        for tick in range(6):
            world.instant(tick, 0, 1, 2)
    assert caplog.text.count("no snapshot: cannot write") == 1
