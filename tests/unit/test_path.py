"""The closed-form motions obey the unicycle's equations."""

import math

import numpy as np
import pytest

from services.world.errors import PathError
from services.world.path import PATHS, open_motion

pytestmark = pytest.mark.unit

MOTIONS = {kind: open_motion(kind, (1.6, 1.2), 40.0) for kind in PATHS}
CLOSED = [kind for kind in PATHS if kind != "line"]


@pytest.mark.parametrize("kind", PATHS)
def test_the_unicycle_driven_by_v_and_omega_stays_on_the_closed_form(kind):
    motion, dt = MOTIONS[kind], 0.05

    def rate(t, state):
        u = motion.at(t)
        return np.array([u.v_m_s * math.cos(state[2]), u.v_m_s * math.sin(state[2]), u.omega_rad_s])

    start = motion.at(0.0)
    state = np.array([*start.position_m, start.heading_rad])
    for step in range(800):  # one lap by RK4.
        t = step * dt
        k1 = rate(t, state)
        k2 = rate(t + dt / 2, state + dt / 2 * k1)
        k3 = rate(t + dt / 2, state + dt / 2 * k2)
        k4 = rate(t + dt, state + dt * k3)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        truth = motion.at(t + dt)
        np.testing.assert_allclose(state[:2], truth.position_m, atol=1e-7)
        assert math.cos(state[2] - truth.heading_rad) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("kind", PATHS)
def test_the_accelerations_are_the_derivatives_of_the_speeds(kind):
    motion, h = MOTIONS[kind], 1e-4
    for t in np.linspace(0.0, 40.0, 23):
        before, now, after = motion.at(t - h), motion.at(t), motion.at(t + h)
        assert now.v_dot == pytest.approx((after.v_m_s - before.v_m_s) / (2 * h), abs=1e-7)
        slope = (after.omega_rad_s - before.omega_rad_s) / (2 * h)
        assert now.omega_dot == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("kind", CLOSED)
def test_after_a_lap_all_is_as_at_the_start(kind):
    motion = MOTIONS[kind]
    for t in (0.0, 3.3, 17.0):
        a, b = motion.at(t), motion.at(t + motion.period_s)
        np.testing.assert_allclose(a.pose(), b.pose(), atol=1e-12)
        np.testing.assert_allclose(a.twist(), b.twist(), atol=1e-12)


@pytest.mark.parametrize("kind", PATHS)
def test_every_motion_starts_at_the_origin(kind):
    assert MOTIONS[kind].at(0.0).position_m == (0.0, 0.0)
    if kind != "eight":
        assert MOTIONS[kind].at(0.0).heading_rad == 0.0


def test_curvature_is_that_of_the_curve():
    ellipse, circle = MOTIONS["ellipse"].at(0.0), MOTIONS["circle"].at(7.7)
    assert ellipse.omega_rad_s / ellipse.v_m_s == pytest.approx(1.2 / 1.6**2)
    flank = MOTIONS["ellipse"].at(10.0)
    assert flank.omega_rad_s / flank.v_m_s == pytest.approx(1.6 / 1.2**2)
    assert circle.omega_rad_s / circle.v_m_s == pytest.approx(1 / 1.6)


def test_the_ellipse_of_the_paper_has_the_paper_s_speeds():
    motion = open_motion("ellipse", (25.0, 12.6157), 200.0)
    states = [motion.at(t) for t in np.linspace(0.0, 200.0, 2001)]
    speeds = [s.v_m_s for s in states]
    turns = [math.degrees(s.omega_rad_s) for s in states]
    assert (min(speeds), max(speeds)) == pytest.approx((0.396, 0.785), abs=5e-4)
    assert (min(turns), max(turns)) == pytest.approx((0.91, 3.57), abs=5e-3)
    assert max(s.omega_rad_s / s.v_m_s for s in states) == pytest.approx(math.pi / 20, rel=2e-3)


def test_the_world_twist_is_the_motion_of_the_pose():
    h = 1e-5
    for motion in MOTIONS.values():
        for t in (0.5, 11.0, 29.0):
            linear, angular = motion.at(t).twist()
            difference = (motion.at(t + h).pose() - motion.at(t - h).pose()) / (2 * h)
            np.testing.assert_allclose(linear, difference[:3, 3], atol=1e-8)
            turn = difference[:2, :2] @ motion.at(t).pose()[:2, :2].T
            assert angular == pytest.approx((0.0, 0.0, turn[1, 0]), abs=1e-8)


@pytest.mark.parametrize(
    ("axes", "lap"), [((0.0, 1.0), 40.0), ((1.0, -1.0), 40.0), ((1.0, 1.0), 0.0)]
)
def test_measures_that_are_not_positive_are_refused(axes, lap):
    with pytest.raises(PathError, match="positive"):
        open_motion("ellipse", axes, lap)
