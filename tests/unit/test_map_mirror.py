"""The mirror holds what the mapper holds, whatever comes in whatever order."""

import numpy as np
import pytest

from schemas.geometry import Pose
from schemas.map import FREE, OCCUPIED, UNKNOWN, MapChanges, MapFull
from services.runtime.map_mirror import MapMirror, Outcome

pytestmark = pytest.mark.unit

ORIGIN_M, VOXEL_M = (-0.6, -0.6, -0.1), 0.01
UNKNOWN_LOG_ODDS = -32768


def header(rev):
    return {
        "t_ns": rev * 10,
        "tick": rev,
        "frame_id": "target",
        "rev": rev,
        "resolution_m": VOXEL_M,
        "origin": ORIGIN_M,
        "shape_voxels": (120, 120, 80),
        "pose": Pose(position=(1, 2, 0), orientation=(0, 0, 0, 1)),
    }


def changes(rows, rev, base_rev):
    array = np.array(rows, np.int16).reshape(-1, 4)
    return MapChanges.of(array, base_rev=base_rev, **header(rev))


def snapshot(voxels, rev):
    """Encode a set of occupied voxels in bricks; what is not in it is free or unknown."""
    voxels = np.array(sorted(voxels), np.int64).reshape(-1, 3)
    bricks = np.unique(voxels // 8, axis=0)
    log_odds = np.full((len(bricks), 8, 8, 8), UNKNOWN_LOG_ODDS, np.int16)
    log_odds[:, 0, 0, 0] = -100
    for index, voxel in enumerate(voxels):
        brick = int(np.flatnonzero((bricks == voxel // 8).all(axis=1))[0])
        log_odds[(brick, *(voxel % 8))] = index % 2 * 500  # 0 is occupied too: p = 0.5.
    array = np.concatenate([bricks, log_odds.reshape(len(bricks), -1)], axis=1)
    return MapFull.of(array.astype(np.int16), **header(rev))


def held(mirror):
    return {tuple(voxel) for voxel in mirror.voxels.tolist()}


def random_changes(rng, num):
    """Distinct voxels with random classes, crossing the origin so that indices are negative."""
    voxels = np.unique(rng.integers(-6, 12, size=(num, 3)), axis=0)
    classes = rng.choice([UNKNOWN, FREE, OCCUPIED], size=len(voxels))
    return rng.permutation(np.column_stack([voxels, classes]))


def test_the_mirror_holds_what_a_set_would_hold():
    rng = np.random.default_rng(0)
    mirror, expected = MapMirror(), set()
    for rev in range(1, 40):
        rows = random_changes(rng, int(rng.integers(0, 600)))
        assert mirror.apply(changes(rows, rev, rev - 1)) is Outcome.APPLIED
        for *voxel, kind in rows.tolist():
            (expected.add if kind == OCCUPIED else expected.discard)(tuple(voxel))
        assert held(mirror) == expected
        assert len(mirror) == len(expected)
        assert mirror.rev == rev


def test_a_gap_leaves_the_mirror_as_it_was_until_a_snapshot_heals_it():
    rng = np.random.default_rng(1)
    mirror = MapMirror()
    mirror.apply(changes(random_changes(rng, 300), 1, 0))
    before = held(mirror)
    assert mirror.apply(changes([[1, 2, 3, OCCUPIED]], 3, 2)) is Outcome.GAP
    assert (held(mirror), mirror.rev) == (before, 1)
    truth = {(0, 0, 0), (-9, 4, 17), (119, 119, 79)}
    assert mirror.reset(snapshot(truth, 3)) is Outcome.APPLIED
    assert (held(mirror), mirror.rev) == (truth, 3)
    assert mirror.apply(changes([[0, 0, 0, FREE]], 4, 3)) is Outcome.APPLIED
    assert held(mirror) == truth - {(0, 0, 0)}


def test_what_is_older_than_the_mirror_is_ignored():
    mirror = MapMirror()
    mirror.reset(snapshot({(1, 1, 1)}, 10))
    assert mirror.apply(changes([[2, 2, 2, OCCUPIED]], 9, 8)) is Outcome.STALE
    assert mirror.apply(changes([[2, 2, 2, OCCUPIED]], 10, 9)) is Outcome.STALE
    assert mirror.reset(snapshot({(3, 3, 3)}, 9)) is Outcome.STALE
    assert held(mirror) == {(1, 1, 1)}


def test_changes_of_the_empty_map_start_afresh():
    mirror = MapMirror()
    mirror.reset(snapshot({(1, 1, 1)}, 10))
    assert mirror.apply(changes([[2, 2, 2, OCCUPIED]], 1, 0)) is Outcome.APPLIED
    assert (held(mirror), mirror.rev) == ({(2, 2, 2)}, 1)


def test_a_forgotten_map_is_empty_and_waits_for_a_snapshot():
    mirror = MapMirror()
    mirror.apply(changes([[2, 2, 2, OCCUPIED]], 7, 0))
    mirror.forget()
    assert (len(mirror), mirror.rev, mirror.latest) == (0, 0, None)
    assert mirror.apply(changes([[2, 2, 2, OCCUPIED]], 3, 2)) is Outcome.GAP


def test_every_index_of_the_format_comes_back():
    ends = [-32768, -1, 0, 1, 32767]
    rows = [[i, j, k, OCCUPIED] for i in ends for j in ends for k in ends]
    mirror = MapMirror()
    mirror.apply(changes(rows, 1, 0))
    assert held(mirror) == {tuple(row[:3]) for row in rows}


def test_centres_lie_in_the_middle_of_their_voxels():
    mirror = MapMirror()
    assert mirror.centres().shape == (0, 3)
    mirror.apply(changes([[60, 60, 10, OCCUPIED], [-1, 0, 0, OCCUPIED]], 1, 0))
    expected = [[-0.605, -0.595, -0.095], [0.005, 0.005, 0.005]]
    assert np.allclose(mirror.centres(), expected)
