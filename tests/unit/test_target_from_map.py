"""The target found in the map: its place, its motion, and what is not it."""

import numpy as np
import pytest

from services.planner.target_from_map import Sight, TargetFromMap, middle
from services.planner.turn_model import Agility, moved, wrap

pytestmark = pytest.mark.unit

DT_NS = 66_666_667
DT_S = DT_NS * 1e-9
SIGHT = Sight(ground_m=0.05, reach_m=0.8, sigma_m=0.02)
VOXEL_M = 0.02


def voxels(points):
    """Return the centres of the voxels that hold points."""
    return (np.unique(np.floor(points / VOXEL_M), axis=0) + 0.5) * VOXEL_M


def blob(x, y, seed=0, num=3000):
    """Return the surface of a can on the ground, 0.4 m high and 0.3 m wide, and the ground."""
    rng = np.random.default_rng(seed)
    around, up = rng.uniform(-np.pi, np.pi, num), rng.uniform(0, 0.4, num)
    radius = 0.15 + rng.normal(0, 0.005, num)
    can = np.stack([x + radius * np.cos(around), y + radius * np.sin(around), up], axis=1)
    ground = np.stack([*rng.uniform(-3, 3, (2, num)), rng.normal(0, 0.005, num)], axis=1)
    return voxels(np.concatenate([can, ground]))


def looking(**settings):
    return TargetFromMap(Agility(0.1, 0.3), 1.0, SIGHT, settings.get("heading_rad", 0.0))


def follow(found, states, first_tick=0):
    """Show a target's states one per tick; return the beliefs of each tick."""
    beliefs = []
    for tick, state in enumerate(states, first_tick):
        found.see(tick * DT_NS, blob(state[0], state[1], seed=tick))
        beliefs.append(found.at(tick * DT_NS))
    return beliefs


def arc(num, start):
    return [moved(np.array(start), tick * DT_S)[0] for tick in range(num)]


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (1.3, -0.7), (-2.0, 2.0)])
def test_the_middle_of_what_stands_on_the_ground_is_the_targets_place(x, y):
    np.testing.assert_allclose(middle(blob(x, y), SIGHT, None), [x, y], atol=0.005)


def test_the_ground_alone_is_no_target():
    ground = blob(0, 0)
    assert middle(ground[ground[:, 2] < SIGHT.ground_m], SIGHT, None) is None
    assert middle(np.empty((0, 3)), SIGHT, None) is None


def test_what_is_out_of_reach_is_something_else():
    both = np.concatenate([blob(0, 0), blob(2.0, 0)])
    np.testing.assert_allclose(middle(both, SIGHT, np.array([0.2, 0.1])), [0, 0], atol=0.005)
    assert middle(both, SIGHT, np.array([0.0, 2.0])) is None


@pytest.mark.parametrize("start", [(0, 0, 0.5, 0.25, 0.2), (1, 1, -2.5, 0.4, 0.0)])
def test_a_moving_target_is_followed_with_speed_turn_rate_and_heading(start):
    states = arc(150, start)
    beliefs = follow(looking(), states)
    late = slice(45, None)
    gaps = np.array([b.mean - s for b, s in zip(beliefs, states, strict=True)])[late]
    assert np.hypot(*gaps[:, :2].T).max() < 0.03
    assert np.abs([wrap(gap) for gap in gaps[:, 2]]).max() < 0.15
    assert np.abs(gaps[:, 3]).max() < 0.06
    assert np.abs(gaps[:, 4]).max() < 0.25


def test_before_it_has_moved_it_stands_and_has_the_heading_that_was_guessed():
    beliefs = follow(looking(heading_rad=0.7), [(0.5, 0.2)] * 40)
    for belief in beliefs:
        np.testing.assert_array_equal(belief.mean[2:], [0.7, 0, 0])
        np.testing.assert_allclose(belief.mean[:2], [0.5, 0.2], atol=0.01)


def test_who_stops_keeps_its_heading_and_who_goes_back_is_in_reverse():
    ahead = arc(60, (0, 0, 0.5, 0.4, 0.0))
    end = ahead[-1]
    found = looking()
    stopped = follow(found, ahead + [end] * 60)[-1]
    assert stopped.mean[2] == pytest.approx(0.5, abs=0.15)
    assert (stopped.mean[3], stopped.mean[4]) == (0, 0)
    back = arc(60, (*end[:2], 0.5, -0.4, 0.0))
    reversing = follow(found, back, 120)[-1]
    assert reversing.mean[2] == pytest.approx(0.5, abs=0.15)
    assert reversing.mean[3] == pytest.approx(-0.4, abs=0.06)


def test_half_a_second_in_which_it_is_not_seen_is_bridged():
    found, states = looking(), arc(100, (0, 0, 0.5, 0.4, 0.3))
    follow(found, states[:90])
    for tick in range(90, 98):
        found.see(tick * DT_NS, np.empty((0, 3)))
    assert found.num_missed == 8
    gap = found.at(97 * DT_NS).mean - states[97]
    assert np.hypot(*gap[:2]) < 0.05
    follow(found, states[98:], 98)
    assert found.num_refused == 0


def test_who_was_lost_is_found_wherever_it_stands_in_the_map():
    found = looking()
    follow(found, arc(60, (0, 0, 0.5, 0.4, 0.3)))
    for tick in range(60, 80):
        found.see(tick * DT_NS, np.empty((0, 3)))
    assert found.at(79 * DT_NS).mean[3] == 0.0
    belief = follow(found, [(-2.0, 2.0)] * 3, 80)[-1]
    np.testing.assert_allclose(belief.mean[:2], [-2, 2], atol=0.01)


def test_something_else_that_stands_about_does_not_draw_it_away():
    found, states = looking(), arc(90, (0, 0, 0.0, 0.3, 0.0))
    pillar = blob(0.6, 1.6)
    for tick, state in enumerate(states):
        own = blob(state[0], state[1], seed=tick)
        found.see(tick * DT_NS, own if tick == 0 else np.concatenate([own, pillar]))
    assert np.hypot(*(found.at(89 * DT_NS).mean - states[-1])[:2]) < 0.03


def test_the_belief_is_a_distribution_at_every_instant():
    for belief in follow(looking(), arc(60, (0, 0, 0.5, 0.4, 0.3))):
        assert np.array_equal(belief.cov, belief.cov.T)
        assert np.linalg.eigvalsh(belief.cov).min() > 0


def test_two_looks_at_one_time_are_borne():
    found = looking()
    for _ in range(6):
        found.see(0, blob(0, 0))
    np.testing.assert_allclose(found.at(0).mean[:2], [0, 0], atol=0.01)


def test_nothing_is_known_before_something_was_seen():
    found = looking()
    found.see(0, np.empty((0, 3)))
    assert found.at(0) is None
    assert (found.num_used, found.num_missed) == (0, 1)
