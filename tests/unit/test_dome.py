"""The dome: its views, the flight between them, the single-camera strategy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.kernels.rigid import look_at, pose_error, rotation_log
from services.planner.dome import dome_views
from services.planner.flight import Flight
from services.planner.motion import Motion, still
from services.planner.strategies.dome import Dome, DomeSettings

pytestmark = pytest.mark.unit

CENTRE = np.array([0.0, 0.0, 0.2])
DWELL_S, TRAVEL_S = 0.2, 1.0
LEG_S = DWELL_S + TRAVEL_S
STEP_S = 1e-5


def random_views(seed, num=5):
    rng = np.random.default_rng(seed)
    eyes = rng.normal(size=(num, 3)) + CENTRE
    return [look_at(eye, rng.normal(size=3)) for eye in eyes]


def flight(views):
    return Flight(views, CENTRE, DWELL_S, TRAVEL_S)


def dome(cameras=1):
    return Dome(
        DomeSettings(cameras=cameras, centre_height_m=0.2, dwell_s=DWELL_S, travel_s=TRAVEL_S)
    )


def test_the_dome_has_three_rings_of_sixteen():
    views = np.array(dome_views())
    level = np.linalg.norm(views[:, :2, 3], axis=1).reshape(3, 16)
    height = views[:, 2, 3].reshape(3, 16)
    np.testing.assert_allclose(level.T, [[0.6, 0.6, 0.424]] * 16, atol=5e-4)
    np.testing.assert_allclose(height.T, [[0.15, 0.35, 0.774]] * 16, atol=5e-4)


def test_views_of_the_dome_look_at_its_axis_level_or_down_by_45_degrees():
    views = np.array(dome_views())
    gaze, eye = views[:, :3, 2], views[:, :3, 3]
    sideways = gaze[:, 0] * eye[:, 1] - gaze[:, 1] * eye[:, 0]
    np.testing.assert_allclose(sideways, 0, atol=1e-12)
    assert np.all(np.sum(gaze[:, :2] * eye[:, :2], axis=1) < 0)
    np.testing.assert_allclose(np.degrees(np.arcsin(gaze[:, 2])), [0] * 32 + [-45] * 16, atol=1e-9)


def test_the_views_of_the_dome_differ():
    eyes = np.array(dome_views())[:, :3, 3]
    distances = np.linalg.norm(eyes[:, None] - eyes[None], axis=2) + np.eye(48)
    assert distances.min() > 0.1


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 12))
def test_flight_velocities_are_the_derivatives_of_the_poses(seed, t):
    tour = flight(random_views(seed))
    before, now, after = tour.at(t - STEP_S), tour.at(t), tour.at(t + STEP_S)
    linear = (after.T[:3, 3] - before.T[:3, 3]) / (2 * STEP_S)
    angular = rotation_log(after.T[:3, :3] @ before.T[:3, :3].T) / (2 * STEP_S)
    np.testing.assert_allclose(now.linear, linear, atol=1e-5)
    np.testing.assert_allclose(now.angular, angular, atol=1e-5)


@given(st.integers(0, 2**32 - 1), st.integers(0, 12), st.floats(0.01, 0.19))
def test_the_camera_rests_at_each_view_in_turn(seed, leg, into_s):
    views = random_views(seed)
    resting = flight(views).at(leg * LEG_S + into_s)
    np.testing.assert_array_equal(resting.T, views[leg % 5])
    assert not resting.linear.any()
    assert not resting.angular.any()


@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_a_flight_keeps_its_distance_from_the_centre(seed, share):
    views = random_views(seed)
    arms = [np.linalg.norm(view[:3, 3] - CENTRE) for view in views[:2]]
    arm = np.linalg.norm(flight(views).at(DWELL_S + share * TRAVEL_S).T[:3, 3] - CENTRE)
    assert min(arms) - 1e-9 <= arm <= max(arms) + 1e-9


def test_a_flight_to_the_opposite_side_goes_around():
    eyes = CENTRE + np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    views = [look_at(eye, CENTRE) for eye in eyes]
    middle = flight(views).at(DWELL_S + TRAVEL_S / 2)
    assert np.linalg.norm(middle.T[:3, 3] - CENTRE) == pytest.approx(1)
    assert np.isfinite(middle.linear).all()


def test_a_view_at_the_centre_itself_is_reached_straight():
    views = [look_at(CENTRE, (1, 0, 0.2)), look_at((1, 0, 0.2), CENTRE)]
    position = flight(views).at(DWELL_S + TRAVEL_S / 2).T[:3, 3]
    np.testing.assert_allclose(position, [0.5, 0, 0.2], atol=1e-12)


def test_one_camera_visits_all_48_views():
    at_rest = still(np.eye(4))
    visited = [dome().plan(at_rest, (leg + 0.01) * LEG_S).views[0].T for leg in range(48)]
    for have, want in zip(visited, dome_views(), strict=True):
        assert pose_error(have, want) == pytest.approx((0, 0), abs=1e-7)


def test_several_cameras_share_the_tour():
    plan = dome(cameras=4).plan(still(np.eye(4)), 0.0)
    for have, want in zip(plan.views, (0, 12, 24, 36), strict=True):
        np.testing.assert_allclose(have.T, dome_views()[want], atol=1e-12)


def test_the_tour_follows_a_moving_target():
    target = Motion(np.eye(4), np.array([0.3, 0, 0]), np.zeros(3))
    view = dome().plan(target, 0.1).views[0]
    np.testing.assert_allclose(view.linear, [0.3, 0, 0])
