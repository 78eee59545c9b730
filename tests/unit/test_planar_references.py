"""The references in the plane: velocities are derivatives, bearings are what cameras see."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.planner.planar import (
    PlanarMotion,
    Slots,
    robot_references,
    wrapped,
    yaw_offsets,
)
from services.planner.ring import ring_angles

pytestmark = pytest.mark.unit

STEP_S = 1e-3  # Five-point differences: error ~ step^4 = 1e-12, rounding ~ 1e-13.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)

seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, 12)


class Wave:
    """A smooth function of time and its first two derivatives: a mean and two sines."""

    def __init__(self, rng, mean, swing):
        self.mean = mean
        self.size = swing * rng.uniform(0.1, 0.5, 2)
        self.rate = rng.uniform(0.2, 1.2, 2)
        self.phase = rng.uniform(0, 2 * np.pi, 2)

    def __call__(self, t, order=0):
        angle = self.rate * np.asarray(t)[..., None] + self.phase + order * np.pi / 2
        value = (self.size * self.rate**order * np.sin(angle)).sum(-1)
        return value + self.mean if order == 0 else value


class Scene:
    """A random smooth target and a random smooth formation."""

    def __init__(self, seed, num, direction=1):
        rng = np.random.default_rng(seed)
        self.v = Wave(rng, direction * 2.0, 0.8)
        self.phi = Wave(rng, rng.uniform(-3, 3), 1.0)
        self.d = Wave(rng, 1.5, 0.8)
        self.theta = [Wave(rng, angle, 0.4) for angle in ring_angles(num)]

    def target(self, t, x=0.0, y=0.0):
        phi, omega, omega_dot = self.phi(t), self.phi(t, 1), self.phi(t, 2)
        return PlanarMotion(x, y, phi, self.v(t), omega, self.v(t, 1), omega_dot)

    def slots(self, t):
        theta = [np.stack([wave(t, order) for wave in self.theta], -1) for order in range(3)]
        return Slots(
            d_m=self.d(t),
            d_dot=self.d(t, 1),
            d_ddot=self.d(t, 2),
            theta_rad=theta[0],
            theta_dot=theta[1],
            theta_ddot=theta[2],
        )

    def shift(self, t, h):
        """How far the target drives from `t` to `t + h`: Gauss's quadrature of its speed."""
        nodes = t + h * (_NODES + 1) / 2
        ways = self.v(nodes) * np.exp(1j * self.phi(nodes)) * _WEIGHTS * h / 2
        return complex(ways.sum())

    def at(self, t, h=0.0):
        way = self.shift(t, h)
        return robot_references(self.target(t + h, way.real, way.imag), self.slots(t + h))


def slope(values):
    """Return the derivative from values at -2, -1, 1, 2 steps."""
    a, b, c, d = values
    return (a - 8 * b + 8 * c - d) / (12 * STEP_S)


def fast(now):
    """Away from a stop: differences of a heading tell nothing where a robot nearly stands."""
    return np.abs(now.v_mps) > 0.3


@given(seeds, counts, st.floats(-20, 20), st.sampled_from([1, -1]))
def test_velocities_are_the_derivatives_of_positions_and_headings(seed, num, t, direction):
    scene = Scene(seed, num, direction)
    now = scene.at(t)
    around = [scene.at(t, steps * STEP_S) for steps in (-2, -1, 1, 2)]
    velocity = slope([each.x_m + 1j * each.y_m for each in around])
    moving = fast(now)
    np.testing.assert_allclose(
        (now.v_mps * np.exp(1j * now.phi_rad))[moving], velocity[moving], atol=1e-6
    )
    turns = slope([wrapped(each.phi_rad - now.phi_rad) for each in around])
    np.testing.assert_allclose(now.omega_rps[moving], turns[moving], atol=1e-6)
    pushes = slope([each.v_mps for each in around])
    np.testing.assert_allclose(now.v_dot[moving], pushes[moving], atol=1e-6)


@given(seeds, counts, st.floats(-20, 20))
def test_speed_and_turning_are_the_written_out_equations(seed, num, t):
    """Eq. (12), and the angular velocity written out in real numbers."""
    scene = Scene(seed, num)
    a, s, now = scene.target(t), scene.slots(t), scene.at(t)
    v, w, d, dd, ddd = a.v_mps, a.omega_rps, s.d_m, s.d_dot, s.d_ddot
    sine, cosine = np.sin(s.theta_rad), np.cos(s.theta_rad)
    turn, push = w + s.theta_dot, a.omega_dot + s.theta_ddot
    squared = d**2 * turn**2 + dd**2 + v**2 + 2 * v * (dd * cosine - d * turn * sine)
    np.testing.assert_allclose(now.v_mps**2, squared, atol=1e-9)
    top = (
        d**2 * turn**2 * s.theta_dot
        + dd**2 * (turn + s.theta_dot)
        + d * dd * push
        - d * ddd * turn
        + v * ((ddd - d * turn * s.theta_dot) * sine)
        + v * ((dd * turn + dd * s.theta_dot + d * push) * cosine)
        - a.v_dot * (dd * sine + d * turn * cosine)
    )
    moving = fast(now)
    np.testing.assert_allclose(now.omega_rps[moving], (w + top / squared)[moving], atol=1e-8)


@given(seeds, counts, st.floats(-20, 20))
def test_the_bearing_is_what_a_camera_on_the_robot_sees(seed, num, t):
    scene = Scene(seed, num)
    now = scene.at(t)
    towards = np.arctan2(-now.y_m, -now.x_m)  # The target is at the origin.
    seen = wrapped(towards - now.phi_rad - now.psi_rad)
    np.testing.assert_allclose(wrapped(seen - now.bearing_rad), 0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(now.x_m, now.y_m), scene.d(t), atol=1e-12)


@given(counts, st.floats(0.1, 3), st.floats(0.1, 3), st.floats(-3, 3))
def test_on_a_straight_line_all_drive_parallel_and_see_the_target_centrally(num, d, v, phi):
    slots = Slots(d, ring_angles(num))
    refs = robot_references(PlanarMotion(1.0, 2.0, phi, v, 0.0), slots)
    np.testing.assert_allclose(refs.bearing_rad, 0, atol=1e-12)
    np.testing.assert_allclose(refs.phi_rad, phi, atol=1e-12)
    np.testing.assert_allclose(refs.v_mps, v)
    np.testing.assert_allclose(refs.omega_rps, 0, atol=1e-12)
    back = robot_references(PlanarMotion(1.0, 2.0, phi, -v, 0.0), slots)
    np.testing.assert_allclose(back.v_mps, -v)  # The same formation backs away.
    np.testing.assert_allclose(back.bearing_rad, 0, atol=1e-12)


@given(st.floats(0.2, 2), st.floats(-0.9, 0.9), counts)
def test_a_turn_at_constant_speed_shows_the_arcsine_of_scale_by_curvature(d, tightness, num):
    """No bearing exceeds arcsin(d kappa), and the worst angle on the circle attains it."""
    target = PlanarMotion(0.0, 0.0, 0.0, 1.0, tightness / d)
    refs = robot_references(target, Slots(d, ring_angles(num)))
    worst = np.arcsin(abs(tightness))
    assert np.abs(refs.bearing_rad).max() <= worst + 1e-9
    theta = np.array([np.pi / 2 - np.arccos(tightness)])  # sin(theta) = d kappa.
    refs = robot_references(target, Slots(d, theta, nominal_rad=theta))
    np.testing.assert_allclose(np.abs(refs.bearing_rad), worst, atol=1e-6)


def test_many_instants_are_the_instants_one_by_one():
    scene, times = Scene(3, 6), np.linspace(0, 5, 7)
    many = robot_references(scene.target(times), scene.slots(times))
    for index, t in enumerate(times):
        one = scene.at(t)
        for name in ("x_m", "y_m", "phi_rad", "v_mps", "omega_rps", "v_dot", "bearing_rad"):
            np.testing.assert_allclose(getattr(many, name)[index], getattr(one, name), atol=1e-12)


def test_a_robot_at_the_centre_of_the_turn_stands_and_keeps_its_heading():
    centre = np.array([np.pi / 2, -np.pi / 2])  # d omega = v: the first is the pivot.
    slots = Slots(2.0, centre, nominal_rad=centre)
    turning = PlanarMotion(0.0, 0.0, 0.3, 1.0, 0.5, v_dot=0.1, omega_dot=0.2)
    refs = robot_references(turning, slots, kept_phi_rad=np.array([1.2, 0.0]))
    assert refs.standing.tolist() == [True, False]
    assert refs.phi_rad[0] == pytest.approx(1.2)
    assert (refs.v_mps[0], refs.omega_rps[0], refs.v_dot[0]) == (0, 0, 0)
    assert refs.v_mps[1] == pytest.approx(2.0)


def test_a_target_that_stops_leaves_the_headings_where_they_were():
    v = np.array([0.0, 0.4, 0.2, 0.0, 0.0, 0.3])
    target = PlanarMotion(np.cumsum(v), 0.0, 0.1, v, 0.3 * v)
    refs = robot_references(target, Slots(1.0, ring_angles(5)))
    assert np.isfinite(refs.omega_rps).all()
    np.testing.assert_allclose(refs.phi_rad[0], 0.1)  # Nothing was kept: the target's.
    np.testing.assert_allclose(refs.phi_rad[3:5], refs.phi_rad[[2, 2]])
    np.testing.assert_allclose(refs.phi_rad[5], refs.phi_rad[2])  # The same curvature.
    assert refs.standing.all(axis=1).tolist() == [True, False, False, True, True, False]


def test_a_reversal_through_a_stop_turns_no_robot_round():
    v = np.linspace(1, -1, 41)
    target = PlanarMotion(0.0, 0.0, 0.2, v, 0.3 * v)
    refs = robot_references(target, Slots(1.5, ring_angles(6)))
    assert refs.standing[20].all()
    np.testing.assert_allclose(refs.phi_rad, np.broadcast_to(refs.phi_rad[0], (41, 6)), atol=1e-9)
    np.testing.assert_allclose(np.diff(refs.v_mps, axis=0).std(axis=0), 0, atol=1e-12)


@given(st.floats(-50, 50))
def test_wrapping_keeps_the_direction(angle):
    out = float(wrapped(np.array(angle)))
    assert -np.pi < out <= np.pi
    assert np.exp(1j * out) == pytest.approx(np.exp(1j * angle))


def test_yaw_offsets_are_those_of_the_paper():
    theta = ring_angles(6)
    expected = np.where(theta > 0, theta - np.pi, theta + np.pi)
    np.testing.assert_allclose(wrapped(yaw_offsets(theta) - expected), 0, atol=1e-12)
