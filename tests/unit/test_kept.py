"""Robots with wheels of which one is lost: the others go on seeing the target from their places."""

import math

import numpy as np
import pytest

from services.kernels.rigid import apply, inverse, look_at, planar
from services.planner.director import Director
from services.planner.formation import FormationSettings
from services.planner.kept import Kept
from services.planner.motion import Motion, stacked
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.wheels import open_carrier
from services.world.path import open_motion

pytestmark = pytest.mark.unit

DT_S = 1 / 15
NUM, LOST = 6, 2
PATH = open_motion("ellipse", (4.0, 3.2), 60.0)
ROOM_RAD = math.radians(40 - 2) - math.asin(0.2 / 0.8)
"""Half the field of view, less a margin and half of what the target fills of it."""


def target_at(t_s):
    state = PATH.at(t_s)
    linear, angular = state.twist()
    return Motion(state.pose(), np.array(linear), np.array(angular))


def enclosing(**formation):
    return Director(
        FormationSettings(
            drive="unicycle", cameras=NUM, radius_m=0.8, elevation_deg=0.0, **formation
        )
    )


@pytest.mark.parametrize("strategy", ["circle", "rings", "sphere", "static"])
def test_when_one_is_lost_the_others_stay_where_they_are_on_the_circle(strategy):
    director = enclosing(strategy=strategy)
    before = director.plan(target_at(0.0), 0.0)
    director.vanish(LOST)
    for tick in range(1, 30):
        target = target_at(tick * DT_S)
        orders = director.plan(target, tick * DT_S)
        assert sorted(orders.cameras) == [0, 1, 3, 4, 5]
        assert orders.num_working == len(orders.views) == len(orders.plan.views) == NUM - 1
        whole = Director(director.formation).plan(target, tick * DT_S).views
        for camera, view in zip(orders.cameras, orders.views, strict=True):
            expected = whole[before.cameras.index(camera)]
            np.testing.assert_allclose(view.T, expected.T, atol=1e-9)


def test_they_keep_the_target_in_view_for_a_lap_and_the_lost_one_comes_back_to_its_place():
    director, carrier = enclosing(), open_carrier("unicycle")
    bearings, told = [], director.plan(target_at(0.0), 0.0)
    for tick in range(900):
        t_s, target = tick * DT_S, target_at(tick * DT_S)
        if tick == 100:
            director.vanish(LOST)
        if tick == 700:
            director.saw(LOST, stacked(told.views).T[0] @ _aside(0.5))
            director.appear(LOST)
        told = director.plan(target, t_s)
        mounted = carrier.carry(told.cameras, told.views, target, t_s, told.psi_rad)
        assert len(mounted) == (NUM - 1 if 100 <= tick < 700 else NUM)
        if tick < 700 or tick > 800:
            bearings += [bearing(each.view, target) for each in mounted]
    assert np.abs(bearings).max() <= ROOM_RAD
    assert told.cameras == tuple(range(NUM))


def carried_after(director, carrier, since_s, lasting_s):
    """Return what is told at the end, and where the target then is."""
    for tick in range(round(lasting_s / DT_S) + 1):
        t_s = since_s + tick * DT_S
        told, target = director.plan(straight(t_s), t_s), straight(t_s)
        mounted = carrier.carry(told.cameras, told.views, target, t_s, told.psi_rad)
    return mounted, target


def straight(t_s):
    return Motion(planar(0.3 * t_s, 0, 0), np.array([0.3, 0, 0]), np.zeros(3))


def seen_at(x_m, y_m, t_s):
    at_m = straight(t_s).T[:3, 3]
    return look_at(at_m + [x_m, y_m, 0.5], at_m + [0.0, 0.0, 0.2])


@pytest.mark.parametrize("aside_m", [(3.0, 0.0), (2.0, 2.0), (0.0, 3.0), (-2.0, 2.0)])
def test_a_robot_that_fills_a_gap_is_built_for_its_place_wherever_it_was_seen(aside_m):
    director, carrier = enclosing(), open_carrier("unicycle")
    carried_after(director, carrier, 0.0, 0.2)
    director.vanish(LOST)
    carried_after(director, carrier, 0.3, 0.2)
    director.saw(9, seen_at(*aside_m, 0.6))
    director.appear(9)
    mounted, target = carried_after(director, carrier, 0.6, 12.0)
    assert len(mounted) == NUM
    for view, _ in mounted:
        assert abs(bearing(view, target)) < 1e-6


def test_a_planner_that_begins_among_cameras_builds_their_robots_for_their_places():
    director, carrier = enclosing(), open_carrier("unicycle")
    for camera, azimuth in enumerate(np.random.default_rng(1).uniform(-np.pi, np.pi, NUM)):
        director.saw(camera, seen_at(2 * np.cos(azimuth), 2 * np.sin(azimuth), 0.0))
    mounted, target = carried_after(director, carrier, 0.0, 12.0)
    for view, _ in mounted:
        assert abs(bearing(view, target)) < 1e-6


def _aside(shift_m):
    T = np.eye(4)
    T[0, 3] = shift_m
    return T


def bearing(view, target):
    x, _, z = apply(inverse(view.T), apply(target.T, [0.0, 0.0, 0.2]))
    return math.atan2(x, z)


def test_two_lost_ones_leave_two_gaps_and_corners_stay_in_order():
    director = enclosing()
    director.plan(target_at(0.0), 0.0)
    director.vanish(1)
    director.plan(target_at(0.1), 0.1)
    director.vanish(4)
    orders = director.plan(target_at(0.2), 0.2)
    assert orders.cameras == (0, 2, 3, 5)
    whole = Director(director.formation).plan(target_at(0.2), 0.2).plan.polygon_m
    np.testing.assert_allclose(orders.plan.polygon_m, [whole[i] for i in (0, 2, 3, 5)])


def test_places_that_are_kept_are_those_of_the_whole():
    circle = Circle(CircleSettings(cameras=5, radius_m=1, elevation_rad=0.2, centre_height_m=0.1))
    whole = circle.plan(target_at(1.0), 1.0)
    kept = Kept(circle, (0, 3)).plan(target_at(1.0), 1.0)
    assert len(kept.views) == len(kept.polygon_m) == 2
    np.testing.assert_array_equal(kept.views[1].T, whole.views[3].T)
    assert kept.radius_m == whole.radius_m
