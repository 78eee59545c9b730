"""The report on what cameras are told now: the same as that of the plan ahead."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.kernels.rigid import look_at, planar
from services.planner.feasibility import check
from services.planner.formation import FormationSettings
from services.planner.live_feasibility import report_on
from services.planner.motion import Motion, still
from services.planner.planar import PlanarMotion, Slots, robot_references
from services.planner.ring import ring_angles
from services.planner.rules import Limits
from services.planner.strategies.open import open_strategy
from services.planner.wheels import Mounted

pytestmark = pytest.mark.unit

CENTRE = np.array([0.0, 0.0, 0.3])
SEEING = Limits(beta_rad=np.radians(30), target_radius_m=0.1)


def moving(x, y, phi, v, omega):
    ahead = np.array([np.cos(phi), np.sin(phi), 0.0])
    return Motion(planar(x, y, phi), v * ahead, np.array([0.0, 0.0, omega]))


def fixed_views(x, y, phi, v, omega, d, num):
    """Cameras of robots with wheels at half a metre, where the planar references say."""
    refs = robot_references(PlanarMotion(x, y, phi, v, omega), Slots(d, ring_angles(num)))
    views = []
    for i in range(num):
        eye = np.array([refs.x_m[i], refs.y_m[i], 0.3])
        gaze = refs.phi_rad[i] + refs.psi_rad[i]
        T = look_at(eye, eye + [np.cos(gaze), np.sin(gaze), 0.0])
        heading = np.array([np.cos(refs.phi_rad[i]), np.sin(refs.phi_rad[i]), 0.0])
        spin = np.array([0.0, 0.0, refs.omega_rps[i]])
        views.append(Motion(T, refs.v_mps[i] * heading, spin))
    return views


def flown(views):
    return [Mounted(view, None) for view in views]


@given(
    st.floats(-3, 3),
    st.floats(0.3, 2),
    st.floats(-1, 1),
    st.floats(0.3, 3),
    st.integers(2, 8),
)
def test_of_robots_on_wheels_it_is_the_report_of_the_plan_ahead(phi, v, omega, d, num):
    state = (1.0, -2.0, phi, v, omega)
    centre = CENTRE + [1.0, -2.0, 0.0]
    limits = replace(SEEING, v_max_mps=2.0, omega_max_rps=1.0, robot_distance_m=0.5, delay_s=0.1)
    live = report_on(flown(fixed_views(*state, d, num)), moving(*state), centre, limits)
    ahead = check(PlanarMotion(*state), Slots(d, ring_angles(num)), limits)
    assert live.kappa_max_1pm == pytest.approx(ahead.kappa_max_1pm)
    assert live.finite_set_scale_m == pytest.approx(ahead.finite_set_scale_m)
    for ours, theirs in zip(live.rules, ahead.rules, strict=True):
        assert (ours.name, ours.limit) == (theirs.name, theirs.limit)
        assert ours.value == pytest.approx(theirs.value, abs=1e-6)
    for ours, theirs in zip(live.robots, ahead.robots, strict=True):
        assert np.exp(1j * ours.theta_rad) == pytest.approx(np.exp(1j * theirs.theta_rad))
        assert ours.bearing_rad == pytest.approx(theirs.bearing_rad, abs=1e-6)
        assert ours.margin_rad == pytest.approx(theirs.margin_rad, abs=1e-6)


@pytest.mark.parametrize("strategy", ["circle", "rings", "sphere", "orbit", "random"])
def test_flying_cameras_look_at_the_target_whatever_their_formation(strategy):
    settings = FormationSettings(strategy=strategy, cameras=7, centre_height_m=0.3)
    target = moving(1.0, 2.0, 0.4, 0.5, 0.8)
    views = open_strategy(settings.strategy_settings()).plan(target, 1.0).views
    flying = replace(SEEING, drive="flying")
    report = report_on(flown(views), target, CENTRE + [1.0, 2.0, 0.0], flying)
    assert report.feasible
    assert len(report.robots) == 7
    assert max(each.bearing_rad for each in report.robots) == pytest.approx(0, abs=1e-9)
    assert report.critical_scale_m is None
    assert report.robots_apart_m > 0


def test_a_rig_at_rest_says_that_the_target_has_left_its_view():
    settings = FormationSettings(strategy="static", cameras=3, centre_height_m=0.3)
    views = open_strategy(settings.strategy_settings()).plan(still(np.eye(4)), 0.0).views
    flying = replace(SEEING, drive="flying")
    assert report_on(flown(views), still(np.eye(4)), CENTRE, flying).feasible
    gone = moving(0.0, 3.0, 0.0, 0.5, 0.0)
    report = report_on(flown(views), gone, CENTRE + [0.0, 3.0, 0.0], flying)
    assert [rule.name for rule in report.rules if not rule.holds] == ["field of view"]


def test_a_camera_at_the_very_centre_is_reported_and_not_divided_by():
    views = [still(look_at(CENTRE, CENTRE + [1, 0, 0]))]
    report = report_on(flown(views), still(np.eye(4)), CENTRE, SEEING)
    assert [rule.name for rule in report.rules if not rule.holds] == [
        "field of view",
        "target apart",
    ]
    assert report.robots_apart_m is None
