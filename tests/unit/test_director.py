"""Changes while running: references without a jump, everybody in a place, gaps closed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.kernels.rigid import apply, integrate_twist, inverse, look_at, planar, rotation_log
from services.planner.director import Director
from services.planner.errors import PlannerError
from services.planner.formation import FormationSettings
from services.planner.motion import Motion, stacked, still

pytestmark = pytest.mark.unit

DT_S = 1 / 60
STEP_S = 1e-5
MAX_SPEED_MPS, MAX_TURN_RPS = 2.0, 2.5  # What a camera's drive can do.
MAX_CHANGE_MPS2 = 6.0  # Its 5, and what the target's own motion adds.
STRATEGIES = ("circle", "rings", "sphere", "orbit", "random", "static", "dome")


def target_at(t):
    """A unicycle on a circle of 0.5 m: slow enough to be lapped by nobody."""
    phase, rate = 0.2 * t, 0.2
    T = planar(0.5 * np.cos(phase), 0.5 * np.sin(phase), phase + np.pi / 2)
    return Motion(T, T[:3, :3] @ [0.5 * rate, 0, 0], np.array([0, 0, rate]))


class Flown:
    """References over time, by camera."""

    def __init__(self, director):
        self.director, self.t, self.last = director, 0.0, {}
        self.speed = self.turn = self.jerk = self.miss = 0.0

    def fly(self, duration_s, dt_s=DT_S):
        for _ in range(round(duration_s / dt_s)):
            self.t += dt_s
            orders = self.director.plan(target_at(self.t), self.t)
            now = dict(zip(orders.cameras, orders.views, strict=True))
            for camera in now.keys() & self.last.keys():
                self.compare(self.last[camera], now[camera], dt_s)
            self.last = now
        return orders

    def compare(self, before, now, dt_s):
        step = np.linalg.norm(now.T[:3, 3] - before.T[:3, 3])
        turn = np.linalg.norm(rotation_log(now.T[:3, :3] @ before.T[:3, :3].T))
        self.speed, self.turn = max(self.speed, step / dt_s), max(self.turn, turn / dt_s)
        change = np.linalg.norm(now.linear - before.linear) / dt_s
        change = max(change, np.linalg.norm(now.angular - before.angular) / dt_s)
        self.jerk = max(self.jerk, change)
        # The twist is the derivative: it leads from one reference to the next.
        mean = (before.linear + now.linear) / 2, (before.angular + now.angular) / 2
        reached = integrate_twist(before.T, *mean, dt_s)
        self.miss = max(self.miss, np.abs(reached - now.T).max())


def begin(**formation):
    flown = Flown(Director(FormationSettings(**formation)))
    flown.fly(1.0)
    return flown


def change(flown, **params):
    flown.director.change(flown.director.formation.changed(params))


def test_a_change_after_a_silence_begins_where_references_are_then():
    flown = begin()
    asked = Director(flown.director.formation)
    asked.plan(target_at(flown.t), flown.t)
    later = flown.t + 10.0
    before = asked.plan(target_at(later), later)
    change(flown, radius_m=2.5)
    after = flown.director.plan(target_at(later), later)
    for one, other in zip(before.views, after.views, strict=True):
        assert np.linalg.norm(one.T[:3, 3] - other.T[:3, 3]) < 0.02


@pytest.mark.parametrize("new", STRATEGIES)
@pytest.mark.parametrize("old", STRATEGIES)
def test_references_are_continuous_from_every_strategy_to_every_other(old, new):
    flown = begin(strategy=old)
    change(flown, strategy=new)
    flown.fly(5.5, 2 * DT_S)
    assert flown.speed < MAX_SPEED_MPS
    assert flown.turn < MAX_TURN_RPS
    assert flown.jerk < MAX_CHANGE_MPS2
    assert flown.miss < 5e-4  # Of the third order in the step: 1/30 s here.


def some_changes(seed, most):
    """Draw changes and how long to wait after each, s; the same ones for ever."""
    rng = np.random.default_rng(seed)
    names = ("circle", "rings", "sphere", "orbit", "random")
    moves = (
        lambda: {"strategy": names[rng.integers(len(names))]},
        lambda: {"cameras": int(rng.integers(1, 13))},
        lambda: {"radius_m": rng.uniform(0.6, 2.0)},
        lambda: {"elevation_deg": rng.uniform(-5, 50)},
        lambda: {"centre_height_m": rng.uniform(0.2, 0.4)},
    )
    num = rng.integers(2, most + 1)
    return [(moves[rng.integers(len(moves))](), rng.uniform(0.05, 1.0)) for _ in range(num)]


@pytest.mark.parametrize("changes", [some_changes(seed, 6) for seed in range(20)])
def test_references_are_continuous_through_changes_in_the_middle_of_changes(changes):
    flown = begin()
    for params, wait_s in changes:
        change(flown, **params)
        flown.fly(wait_s + DT_S)
    flown.fly(2.5)
    assert flown.speed < MAX_SPEED_MPS
    assert flown.jerk < 4 * MAX_CHANGE_MPS2
    assert flown.miss < 1e-3


@pytest.mark.parametrize("new", STRATEGIES)
def test_in_a_change_velocities_are_the_derivatives_of_the_poses(new):
    flown = begin(strategy="orbit")
    change(flown, strategy=new, radius_m=1.4)
    flown.fly(0.7)
    now = stacked(flown.director.plan(target_at(flown.t), flown.t).views)
    later = flown.t + STEP_S
    then = stacked(flown.director.plan(target_at(later), later).views)
    linear = (then.T[:, :3, 3] - now.T[:, :3, 3]) / STEP_S
    turns = then.T[:, :3, :3] @ now.T[:, :3, :3].transpose(0, 2, 1)
    angular = np.array([rotation_log(turn) for turn in turns]) / STEP_S
    np.testing.assert_allclose((now.linear + then.linear) / 2, linear, atol=1e-6)
    np.testing.assert_allclose((now.angular + then.angular) / 2, angular, atol=1e-6)


def test_in_a_change_every_camera_keeps_looking_at_the_centre():
    flown = begin(strategy="circle")
    change(flown, strategy="sphere", radius_m=1.6)
    for _ in range(20):
        orders = flown.fly(0.1)
        for view in orders.views:
            centre = apply(inverse(view.T), orders.plan.centre_m)
            np.testing.assert_allclose(centre[:2], 0, atol=1e-9)


@pytest.mark.parametrize("strategy", ["circle", "orbit", "rings", "sphere"])
def test_a_lost_camera_soon_leaves_no_gap_and_gets_a_place_when_it_returns(strategy):
    flown = begin(strategy=strategy)
    flown.director.vanish(2)
    orders = flown.fly(1 + DT_S)
    assert sorted(orders.cameras) == [0, 1, 3, 4, 5]
    five = Director(FormationSettings(strategy=strategy, cameras=5))
    same_shape(orders.views, five.plan(target_at(flown.t), flown.t).views)
    body = look_at((1.0, 0.5, 0.7), (0, 0, 0.2))
    flown.director.saw(2, body)
    flown.director.appear(2)
    back = flown.fly(DT_S)
    # It starts from where it is, and all six end on six places.
    first = back.views[back.cameras.index(2)]
    np.testing.assert_allclose(first.T, body, atol=0.02)
    orders = flown.fly(4.0)
    six = Director(FormationSettings(strategy=strategy))
    same_places(orders.views, six.plan(target_at(flown.t), flown.t).views)
    assert flown.speed < MAX_SPEED_MPS


# Rings of seven have to send one camera 0.86 m from ring to ring.
LONGEST_S = {"circle": 0.8, "orbit": 0.8, "sphere": 1.0, "rings": 1.05}
# Their views are given, or drawn, where they are: as far as it is to the nearest.
LONGEST_S |= {"static": 2.0, "random": 2.5, "dome": 3.6}


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_whichever_camera_dies_the_others_are_in_their_places_in_time(strategy):
    for num in range(6, 13) if strategy in ("rings", "sphere") else (6, 7, 9):
        for lost in range(num):
            director = Director(FormationSettings(strategy=strategy, cameras=num))
            director.plan(target_at(0.0), 0.0)
            director.vanish(lost)
            director.plan(target_at(DT_S), DT_S)
            late_s = LONGEST_S[strategy]
            orders = director.plan(target_at(late_s), late_s)
            np.testing.assert_array_equal(stacked(orders.views).T, stacked(orders.plan.views).T)


def same_shape(have, want):
    """Compare two sets of views but for a turn about the vertical through the centre."""
    eyes = [stacked(views).T[:, :3, 3] for views in (have, want)]
    apart = [np.sort(np.linalg.norm(e[:, None] - e[None], axis=2), axis=None) for e in eyes]
    np.testing.assert_allclose(*apart, atol=1e-6)
    np.testing.assert_allclose(*(np.sort(e[:, 2]) for e in eyes), atol=1e-9)


def same_places(have, want):
    """Compare two sets of views without regard to who is in which."""
    eyes = stacked(have).T[:, :3, 3], stacked(want).T[:, :3, 3]
    apart = np.linalg.norm(eyes[0][:, None] - eyes[1][None], axis=2)
    assert len(have) == len(want)
    np.testing.assert_allclose(apart.min(axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(apart.min(axis=1), 0, atol=1e-6)


def test_cameras_too_many_wait_farther_out_and_come_back():
    flown = begin(cameras=6)
    for camera in range(6):
        flown.director.appear(camera)
        flown.director.saw(camera, np.eye(4))  # It is led already: where it is does not matter.
    change(flown, cameras=4)
    orders = flown.fly(4.0)
    assert orders.num_working == 4
    assert len(orders.cameras) == 6
    arms = [np.linalg.norm(view.T[:3, 3] - orders.plan.centre_m) for view in orders.views]
    np.testing.assert_allclose(arms, [1.1] * 4 + [1.65] * 2)
    change(flown, cameras=6)
    orders = flown.fly(4.0)
    arms = [np.linalg.norm(view.T[:3, 3] - orders.plan.centre_m) for view in orders.views]
    np.testing.assert_allclose(arms, [1.1] * 6)
    assert flown.speed < MAX_SPEED_MPS


def test_a_camera_of_another_number_takes_the_place_of_a_lost_one():
    flown = begin(cameras=3)
    flown.director.appear(7)
    assert sorted(flown.fly(DT_S).cameras) == [0, 1, 2]  # Nobody knows where it is.
    flown.director.saw(7, look_at((2, 0, 1), (0, 0, 0.2)))
    assert flown.fly(DT_S).num_working == 3
    flown.director.vanish(1)
    assert sorted(flown.fly(DT_S).cameras) == [0, 2, 7]


def test_at_the_start_cameras_take_the_places_that_are_nearest():
    director = Director(FormationSettings(cameras=4))
    places = Director(FormationSettings(cameras=4)).plan(still(np.eye(4)), 0.0).views
    for camera in range(4):
        director.saw(camera, places[3 - camera].T)
    orders = director.plan(still(np.eye(4)), 0.0)
    assert orders.cameras == (3, 2, 1, 0)
    for camera, view in zip(orders.cameras, orders.views, strict=True):
        np.testing.assert_allclose(view.T, places[3 - camera].T, atol=1e-9)


def test_when_time_goes_back_everybody_begins_in_the_first_places():
    flown = begin()
    change(flown, radius_m=2.0)
    flown.fly(0.3)
    orders = flown.director.plan(target_at(0.0), 0.0)
    fresh = Director(flown.director.formation).plan(target_at(0.0), 0.0)
    for one, other in zip(orders.views, fresh.views, strict=True):
        np.testing.assert_array_equal(one.T, other.T)


def test_a_message_that_was_overtaken_is_no_reset():
    flown = begin()
    change(flown, radius_m=2.0)
    flown.fly(0.5)
    before = flown.last[0].T
    flown.director.plan(target_at(flown.t - 0.1), flown.t - 0.1)
    flown.fly(DT_S)
    np.testing.assert_allclose(flown.last[0].T, before, atol=0.05)


fixed = st.tuples(st.sampled_from(("circle", "rings", "sphere", "orbit")), st.integers(1, 12))


@settings(max_examples=20, deadline=None)
@given(fixed, fixed, st.floats(0.8, 2.0))
def test_in_a_change_nobody_comes_too_near_to_another_or_to_the_target(old, new, radius_m):
    flown = begin(cameras=12)
    for camera in range(12):
        flown.director.appear(camera)
        flown.director.saw(camera, np.eye(4))  # It is led already: where it is does not matter.
    change(flown, strategy=old[0], cameras=old[1])
    flown.fly(6.0, 0.5)
    change(flown, strategy=new[0], cameras=new[1], radius_m=radius_m)
    nearest_m, lowest_m = np.inf, np.inf
    for _ in range(60):
        orders = flown.fly(0.06, 0.06)
        eyes = stacked(orders.views).T[:, :3, 3]
        apart = np.linalg.norm(eyes[:, None] - eyes[None], axis=2) + 10 * np.eye(len(eyes))
        nearest_m = min(nearest_m, apart.min())
        arms = np.linalg.norm(eyes - orders.plan.centre_m, axis=1)
        assert arms.min() > min(1.1, radius_m) - 1e-6
        lowest_m = min(lowest_m, eyes[:, 2].min())
    assert nearest_m > 0.19
    assert lowest_m > 0


def test_the_same_instant_asked_twice_gives_the_same_answer():
    flown = begin()
    change(flown, strategy="sphere")
    flown.fly(0.3)
    a, b = (flown.director.plan(target_at(flown.t), flown.t) for _ in range(2))
    np.testing.assert_array_equal(stacked(a.views).T, stacked(b.views).T)


def test_with_every_camera_lost_the_formation_stays_as_it_was():
    flown = begin(cameras=2)
    flown.director.vanish(0)
    flown.director.vanish(1)
    assert sorted(flown.fly(2.0).cameras) == [0, 1]


def test_a_strategy_that_cannot_be_had_changes_nothing():
    flown = begin()
    with pytest.raises(PlannerError, match="/none: cannot be read"):
        change(flown, strategy="dome", view_file="/none")
    assert flown.director.formation.strategy == "circle"


@pytest.mark.parametrize("changes", [some_changes(seed, 5) for seed in range(12)])
def test_changes_in_the_middle_of_changes_keep_cameras_apart_as_well(changes):
    flown = begin()
    nearest_m, farthest_m = apart(flown.fly(DT_S)), np.inf
    for params, wait_s in [*changes, ({}, 3.0)]:
        change(flown, **params)
        for _ in range(max(1, round(wait_s / 0.05))):
            nearest_m = min(nearest_m, apart(flown.fly(0.05, 0.05)))
        formation = flown.director.formation
        farthest_m = min(farthest_m, alone(formation))
    assert nearest_m > 0.98 * min(0.2, farthest_m)


def apart(orders):
    eyes = stacked(orders.views).T[:, :3, 3]
    gaps = np.linalg.norm(eyes[:, None] - eyes[None], axis=2)
    return (gaps + 10 * np.eye(len(eyes))).min()


def alone(formation):
    """What a formation keeps of its own, with nothing changing."""
    director = Director(formation)
    return min(apart(director.plan(target_at(t), t)) for t in np.arange(0, 9, 0.1))
