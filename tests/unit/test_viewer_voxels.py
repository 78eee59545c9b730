"""The voxels of the view: their places, ages and probabilities, and never too many."""

import numpy as np
import pytest

from schemas.geometry import Pose
from schemas.map import LOG_ODDS_PER_UNIT, OCCUPIED, MapChanges, MapFull
from services.kernels.rigid import apply, planar
from services.viewer.voxels import ColourBy, Voxels

pytestmark = pytest.mark.unit


@pytest.fixture
def rng():
    return np.random.default_rng(20)


SIZE_M = 0.02
SHAPE = (64, 64, 64)
POSE = Pose.from_matrix(planar(1.0, -2.0, 0.7))


def changes(voxels, *, t_s=0.0, origin=(-0.6, -0.6, 0.0), rev=1):
    rows = np.column_stack([voxels, np.full(len(voxels), OCCUPIED)]).astype(np.int16)
    return MapChanges.of(
        rows,
        t_ns=round(t_s * 1e9),
        tick=rev,
        frame_id="target",
        rev=rev,
        base_rev=0,
        resolution_m=SIZE_M,
        origin=origin,
        shape_voxels=SHAPE,
        pose=POSE,
    )


def some(rng, num):
    cells = rng.choice(SHAPE[0] ** 3, num, replace=False)
    return np.stack(np.unravel_index(cells, SHAPE), axis=1).astype(np.int64)


def world_of(points):
    return apply(points.T_world_points, points.positions_m)


def test_points_are_where_the_voxels_are(rng):
    held = some(rng, 500)
    voxels = Voxels()
    voxels.update(changes(held), held)
    points = voxels.points(ColourBy.HEIGHT)
    inside = np.array((-0.6, -0.6, 0.0)) + (held + 0.5) * SIZE_M
    expected = apply(POSE.matrix(), inside)
    found = world_of(points)
    assert points.num_true == len(found) == 500
    order = np.lexsort(expected.round(4).T), np.lexsort(found.round(4).T)
    np.testing.assert_allclose(found[order[1]], expected[order[0]], atol=1e-5)


@pytest.mark.parametrize("by", list(ColourBy))
def test_no_more_is_drawn_than_the_limit_and_all_are_counted(rng, by):
    held = some(rng, 5000)
    voxels = Voxels()
    voxels.update(changes(held), held)
    points = voxels.points(by, limit=700)
    assert len(points.positions_m) == len(points.colours) == 700
    assert points.num_true == 5000


def test_of_too_many_always_the_same_are_left_out(rng):
    held = some(rng, 5000)
    voxels = Voxels()
    voxels.update(changes(held), held)
    before = {tuple(row) for row in voxels.points(ColourBy.AGE, 700).positions_m.tolist()}
    fewer = held[100:]
    voxels.update(changes(fewer, rev=2), fewer)
    after = {tuple(row) for row in voxels.points(ColourBy.AGE, 700).positions_m.tolist()}
    # A tenth of a fiftieth has gone: what takes its place is all that may differ.
    assert len(before - after) <= 40


def test_what_is_left_out_is_spread_evenly():
    held = np.argwhere(np.ones((40, 40, 10), bool)).astype(np.int64)
    voxels = Voxels()
    voxels.update(changes(held), held)
    drawn = voxels.points(ColourBy.HEIGHT, 4000).positions_m
    in_octant = (drawn < drawn.max(axis=0) / 2).all(axis=1).sum()
    assert 350 < in_octant < 650


def test_a_voxel_ages_until_it_goes(rng):
    held = some(rng, 100)
    voxels = Voxels()
    voxels.update(changes(held, t_s=10.0), held)
    assert not voxels.ages_s().any()
    later, new = held[:60], np.array([[63, 63, 63]])
    assert not (held == new).all(axis=1).any()
    now = np.concatenate([later, new])
    voxels.update(changes(now, t_s=12.0, rev=2), now)
    ages = voxels.ages_s()
    assert np.count_nonzero(np.isclose(ages, 2.0)) == 60
    assert np.count_nonzero(ages == 0.0) == len(new)
    voxels.update(changes(held, t_s=13.0, rev=3), held)  # Those that had gone are young again.
    assert np.count_nonzero(voxels.ages_s() == 0.0) == 40


def test_ages_survive_a_box_that_moves(rng):
    held = some(rng, 100)
    held[:, 0] = held[:, 0] // 2 + 16
    held = np.unique(held, axis=0)
    voxels = Voxels()
    voxels.update(changes(held, t_s=1.0), held)
    moved = held - [8, 0, 0]
    voxels.update(changes(moved, t_s=3.0, rev=2, origin=(-0.6 + 8 * SIZE_M, -0.6, 0.0)), moved)
    np.testing.assert_allclose(voxels.ages_s(), 2.0)


def test_a_new_run_makes_all_young(rng):
    held = some(rng, 10)
    voxels = Voxels()
    voxels.update(changes(held, t_s=50.0), held)
    voxels.update(changes(held, t_s=0.0, rev=2), held)
    assert not voxels.ages_s().any()


def test_probabilities_are_those_of_the_snapshot(rng):
    log_odds = rng.integers(-3, 4, (4, 8, 8, 8)) * 8192
    log_odds = np.clip(log_odds, -32767, 32767).astype(np.int16)
    bricks = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [3, 3, 3]], np.int16)
    full = MapFull.of(
        np.hstack([bricks, log_odds.reshape(4, -1)]),
        **{name: getattr(changes(bricks), name) for name in MapFull.model_fields
           if name not in ("shape", "dtype", "data")},
    )  # fmt: skip
    brick, i, j, k = np.nonzero(log_odds >= 0)
    held = bricks[brick].astype(np.int64) * 8 + np.stack([i, j, k], axis=1)
    known, extra = held[:-5], np.array([[60, 60, 60]])
    voxels = Voxels()
    voxels.update(changes(known), np.concatenate([known, extra]))
    assert set(voxels.probabilities()) == {0.5}
    voxels.learn(full)
    odds = log_odds[brick, i, j, k][:-5] * LOG_ODDS_PER_UNIT
    expected = np.append(1 / (1 + np.exp(-odds)), 0.5)
    np.testing.assert_allclose(np.sort(voxels.probabilities()), np.sort(expected), atol=1e-6)
    # Coloured by them, the snapshot itself is drawn: no voxel is without.
    points = voxels.points(ColourBy.PROBABILITY)
    np.testing.assert_array_equal(
        np.unique(points.positions_m, axis=0),
        np.unique(((held + 0.5) * SIZE_M).astype(np.float32), axis=0),
    )
    assert len(voxels.points(ColourBy.HEIGHT).positions_m) == len(known) + 1


def test_before_the_first_map_there_is_nothing():
    assert Voxels().points(ColourBy.HEIGHT) is None
    assert len(Voxels().centres_m) == 0
    empty = Voxels()
    empty.update(changes(np.empty((0, 3))), np.empty((0, 3), np.int64))
    for by in ColourBy:
        assert len(empty.points(by).positions_m) == 0
