"""A snapshot comes back whole or not at all, whatever happened to its file."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from services.mapper.errors import MapperError
from services.mapper.settings import MapperSettings
from services.mapper.snapshot import About, Snapshot
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

SETTINGS = {"memory": "persistent", "voxel_size": 0.02}
ABOUT = About(frame="target", tick=41)


def empty() -> VoxelMap:
    return MapperSettings(**SETTINGS).empty_map()


def a_map(seed: int = 0) -> VoxelMap:
    voxel_map = empty()
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (3000, 3))
    voxel_map.fuse_points(points, (0.0, 0.0, 2.0))
    return voxel_map


def same(one: VoxelMap, other: VoxelMap) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(rows(one), rows(other), strict=True))


def num_known(voxel_map: VoxelMap) -> int:
    return voxel_map.counts().free + voxel_map.counts().occupied


def rows(voxel_map: VoxelMap) -> tuple[np.ndarray, np.ndarray]:
    stored = voxel_map.stored()
    known = (stored.log_odds != -32768).any(axis=1)
    order = np.lexsort(stored.bricks[known].T)
    return stored.bricks[known][order], stored.log_odds[known][order]


def test_what_is_saved_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    snapshot, saved, loaded = Snapshot(tmp_path / "a.npz"), a_map(), empty()
    snapshot.save(saved.stored(), ABOUT)
    restored = snapshot.restore(loaded, "target")
    assert restored is not None
    assert restored.tick == 41
    assert 0.0 <= restored.age_s < 60.0
    assert same(saved, loaded)
    assert loaded.counts().occupied > 100
    assert len(loaded.changes()) == num_known(loaded)


def test_the_file_is_a_map_that_others_read(tmp_path: Path) -> None:
    Snapshot(tmp_path / "a.npz").save(a_map().stored(), ABOUT)
    assert VoxelMap.load(tmp_path / "a.npz").counts() == a_map().counts()


def test_no_snapshot_is_no_trouble(tmp_path: Path) -> None:
    assert Snapshot(tmp_path / "a.npz").restore(empty(), "target") is None


def damaged(data: bytes) -> list[bytes]:
    """Cut off and overwrite at many places."""
    rng = np.random.default_rng(2)
    cuts = [data[: int(at)] for at in (0, 1, *rng.integers(2, len(data) - 1, 30))]
    places = [int(at) for at in rng.integers(0, len(data) - 64, 30)]
    return cuts + [data[:at] + rng.bytes(64) + data[at + 64 :] for at in places]


def test_a_torn_snapshot_is_refused_and_put_aside_and_the_map_is_empty(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    snapshot, saved = Snapshot(path), a_map()
    snapshot.save(saved.stored(), ABOUT)
    aside, refused = tmp_path / "a.npz.refused", 0
    for data in damaged(path.read_bytes()):
        path.write_bytes(data)
        loaded = empty()
        try:
            snapshot.restore(loaded, "target")
            assert same(saved, loaded)  # What was overwritten says nothing: padding, dates.
        except MapperError as error:
            reason = str(error)
            refused += 1
        else:
            continue
        assert str(aside) in reason
        assert not path.exists()
        assert aside.read_bytes() == data
        assert num_known(loaded) == len(loaded.changes()) == 0
    assert refused >= 55


@pytest.mark.parametrize(
    ("other", "reason"),
    [({"voxel_size": 0.04}, "voxels of 0.04 m"), ({"box_max_m": (0.9, 0.6, 0.7)}, "its box is")],
)
def test_a_snapshot_of_another_map_is_refused(tmp_path: Path, other: dict, reason: str) -> None:
    snapshot = Snapshot(tmp_path / "a.npz")
    snapshot.save(a_map().stored(), ABOUT)
    loaded = MapperSettings(**{**SETTINGS, **other}).empty_map()
    with pytest.raises(MapperError, match=reason):
        snapshot.restore(loaded, "target")
    assert num_known(loaded) == 0


def test_a_snapshot_of_another_frame_is_refused(tmp_path: Path) -> None:
    snapshot = Snapshot(tmp_path / "a.npz")
    snapshot.save(a_map().stored(), ABOUT)
    with pytest.raises(MapperError, match="a map of frame target; this one is of world"):
        snapshot.restore(empty(), "world")


def test_what_is_forgotten_does_not_come_back(tmp_path: Path) -> None:
    snapshot = Snapshot(tmp_path / "a.npz")
    snapshot.forget()
    snapshot.save(a_map().stored(), ABOUT)
    snapshot.forget()
    assert snapshot.restore(empty(), "target") is None


WRITER = textwrap.dedent("""
    import sys
    from pathlib import Path
    from tests.unit.test_snapshot import ABOUT, Snapshot, a_map
    stored = [a_map(seed).stored() for seed in (0, 1)]
    snapshot, number = Snapshot(Path(sys.argv[1])), 0
    while True:
        snapshot.save(stored[number % 2], ABOUT)
        number += 1
        print(number, flush=True)
    """)


def test_a_writer_killed_in_the_middle_leaves_a_whole_snapshot(tmp_path: Path) -> None:
    path, known, in_the_middle = tmp_path / "a.npz", [a_map(0), a_map(1)], 0
    rng = np.random.default_rng(3)
    for _ in range(3):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)],
            cwd=Path(__file__).parents[2],
            stdout=subprocess.PIPE,
        )
        assert writer.stdout is not None
        assert writer.stdout.readline()
        until_s = time.monotonic() + 2.0
        while time.monotonic() < until_s and not list(tmp_path.glob(".a.npz.*.part")):
            pass  # Killed while it writes, as far as that can be seen from here.
        time.sleep(float(rng.uniform(0.0, 0.002)))
        os.kill(writer.pid, signal.SIGKILL)
        writer.communicate()
        in_the_middle += bool(list(tmp_path.glob(".a.npz.*.part")))
        loaded = empty()
        assert Snapshot(path).restore(loaded, "target") is not None
        assert any(same(loaded, each) for each in known)
        assert not list(tmp_path.glob(".*.part"))
    assert in_the_middle


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"memory": "instant"}, "choose memory persistent"),
        ({"memory": "decay"}, "choose memory persistent"),
        ({"dynamic": True}, "no dynamic"),
        ({"color": True}, "no color"),
        ({"frame": "world", "follow": "target"}, "follow none"),
    ],
)
def test_a_snapshot_goes_with_what_is_kept(tmp_path: Path, wrong: dict, reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        MapperSettings(**{**SETTINGS, "snapshot": tmp_path / "a.npz", **wrong})


@pytest.mark.parametrize("name", ["a.ply", "none/a.npz"])
def test_a_snapshots_name_and_folder_are_checked_before_it_is_needed(
    tmp_path: Path, name: str
) -> None:
    with pytest.raises(ValidationError, match=r"must end with \.npz and lie in a folder"):
        MapperSettings(**SETTINGS, snapshot=tmp_path / name)
