"""The tracking controllers: laws of each, and the figures of the literature's example."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from services.camera.controllers.controller import SLOWEST_MPS
from services.camera.controllers.dynamic_feedback import (
    RETURN_SHARE,
    DynamicFeedbackGains,
    Momentum,
    advance,
    linearised,
)
from services.camera.controllers.input_output import InputOutputGains, input_output
from services.camera.controllers.kanayama import KanayamaGains, kanayama
from services.camera.controllers.morin_samson import (
    TURN_FIRST_RAD,
    MorinSamsonGains,
    morin_samson,
)
from services.camera.controllers.open import open_controller
from services.camera.controllers.planar import Drive, PlanarError, Posture, driven, error_of
from services.camera.controllers.samson import SamsonGains, samson
from tests.enclosing import ALL_GAINS, DT_S, LIMITS, NUM_ROBOTS, lap, track

pytestmark = pytest.mark.unit

RADIUS_M = 3.226
START = (0.5, -0.5, 0.4)
ORACLE = [
    ("kanayama", 0.4, 2.6),
    ("samson", 0.4, 2.1),
    ("dynamic_feedback", 0.8, 4.0),
    ("morin_samson", 1.2, 3.9),
    ("input_output", 0.4, 2.8),
]
"""Largest error once on the track, mm; time until it is below 5 cm from `START`, s."""
names = pytest.mark.parametrize("name", ALL_GAINS)


def numbers(bound):
    return st.floats(-bound, bound, allow_nan=False)


errors = st.builds(PlanarError, numbers(5), numbers(5), numbers(math.pi))
drives = st.builds(Drive, numbers(1.5), numbers(1.0), numbers(1.0))


def rates(error, drive, velocity):
    """How the error changes: e_x', e_y', e_phi'."""
    v, omega = velocity.v_mps, velocity.omega_rps
    return np.array(
        [
            omega * error.y_m - v + drive.v_mps * math.cos(error.phi_rad),
            -omega * error.x_m + drive.v_mps * math.sin(error.phi_rad),
            drive.omega_rps - omega,
        ]
    )


# The example of the literature: N = 5, d = 3.226 m, 20 steps a second.


@pytest.mark.parametrize(("name", "oracle_mm", "oracle_s"), ORACLE)
def test_the_example_is_tracked_as_well_and_reached_as_soon_as_published(name, oracle_mm, oracle_s):
    references, target_m = lap(RADIUS_M)
    for robot in range(NUM_ROBOTS):
        on_track = track(references, target_m, robot, ALL_GAINS[name])
        assert on_track.error_m.max() * 1e3 < oracle_mm + 0.05
        assert math.sqrt((on_track.error_m**2).mean()) < 5e-3
    references, target_m = lap(RADIUS_M, duration_s=15.0)
    for robot in range(NUM_ROBOTS):
        off_track = track(references, target_m, robot, ALL_GAINS[name], offset=START)
        reached_s = (np.flatnonzero(off_track.error_m > 0.05).max() + 1) * DT_S
        assert reached_s < oracle_s + 0.1
        assert off_track.error_m[-1] < 5e-3
        for velocity in off_track.velocities:
            assert abs(velocity.v_mps) <= LIMITS.max_speed_mps
            assert abs(velocity.omega_rps) <= LIMITS.max_turn_rps


# Laws without saturation: what each controller's own function of the error does.


@given(errors, drives)
def test_kanayama_s_function_never_grows(error, drive):
    gains = KanayamaGains()
    slope = np.array([error.x_m, error.y_m, math.sin(error.phi_rad) / gains.k_y])
    assert slope @ rates(error, drive, kanayama(error, drive, gains)) <= 1e-9


@given(errors, drives)
def test_samson_s_function_never_grows(error, drive):
    gains = SamsonGains()
    slope = np.array([gains.b * error.x_m, gains.b * error.y_m, error.phi_rad])
    assert slope @ rates(error, drive, samson(error, drive, gains)) <= 1e-9


@given(errors, drives)
def test_the_function_of_morin_and_samson_never_grows_where_their_law_holds(error, drive):
    assume(abs(error.phi_rad) < TURN_FIRST_RAD)
    gains = MorinSamsonGains()
    tangent = math.tan(error.phi_rad)
    # |q_r - q| is the same in whatever axes.
    slope = np.array([error.x_m, error.y_m, tangent / math.cos(error.phi_rad) ** 2 / gains.k_y])
    change = slope @ rates(error, drive, morin_samson(error, drive, gains))
    assert change <= 1e-9 * max(1.0, tangent**2)


@given(errors, drives, numbers(2))
def test_dynamic_feedback_makes_the_robot_a_double_integrator(error, drive, speed_mps):
    assume(abs(speed_mps) > 0.05)
    gains = DynamicFeedbackGains()
    acceleration, omega_rps = linearised(error, drive, gains, speed_mps)
    c, s = math.cos(error.phi_rad), math.sin(error.phi_rad)
    heading, left = np.array([c, s]), np.array([-s, c])
    robot = np.array([acceleration, speed_mps * omega_rps])
    reference = drive.v_dot * heading + drive.v_mps * drive.omega_rps * left
    closing = drive.v_mps * heading - [speed_mps, 0.0]
    expected = -gains.k_d * closing - gains.k_p * np.array([error.x_m, error.y_m])
    np.testing.assert_allclose(reference - robot, expected, atol=1e-9)


@given(errors, drives)
def test_the_point_ahead_closes_in_exponentially_from_anywhere(error, drive):
    gains = InputOutputGains()
    b = math.copysign(gains.b_m, drive.v_mps)
    c, s = math.cos(error.phi_rad), math.sin(error.phi_rad)
    point = np.array([error.x_m + b * (c - 1), error.y_m + b * s])
    velocity = input_output(error, drive, gains)
    # The point's error in the robot's axes, and how fast these turn.
    speed_r = np.array([drive.v_mps * c - b * drive.omega_rps * s,
                        drive.v_mps * s + b * drive.omega_rps * c])  # fmt: skip
    speed = np.array([velocity.v_mps, b * velocity.omega_rps])
    np.testing.assert_allclose(speed_r - speed, -gains.k * point, atol=1e-9)


# No reference makes any of them divide by zero or exceed what the robot can do.


@names
@given(
    error=st.builds(PlanarError, numbers(1e6), numbers(1e6), numbers(math.pi)),
    drive=st.builds(
        Drive,
        st.one_of(st.just(0.0), numbers(1e6)),
        st.one_of(st.just(0.0), numbers(1e6)),
        numbers(1e6),
    ),
    steps=st.integers(1, 3),
)
def test_every_output_is_finite_and_within_the_limits(name, error, drive, steps):
    controller = open_controller(ALL_GAINS[name], LIMITS)
    for _ in range(steps):
        velocity = controller.steer(error, drive, DT_S)
        assert math.isfinite(velocity.v_mps)
        assert math.isfinite(velocity.omega_rps)
        assert abs(velocity.v_mps) <= LIMITS.max_speed_mps
        assert abs(velocity.omega_rps) <= LIMITS.max_turn_rps


def settle(name, drive, error, duration_s=30.0):
    """Follow a reference that drives steadily from an error; return the last one."""
    controller = open_controller(ALL_GAINS[name], LIMITS)
    reference = Posture(0.0, 0.0, 0.3)
    robot = Posture(-error.x_m, -error.y_m, 0.3 - error.phi_rad)
    for _ in range(round(duration_s / DT_S)):
        velocity = controller.steer(error_of(robot, reference), drive, DT_S)
        robot = driven(robot, velocity, DT_S)
        reference = driven(reference, drive, DT_S)
    return error_of(robot, reference)


@names
@pytest.mark.parametrize("v_mps", [0.8, -0.8])
def test_a_reference_is_reached_forwards_and_in_reverse(name, v_mps):
    left = settle(name, Drive(v_mps, 0.1), PlanarError(0.5, -0.3, 0.4))
    assert math.hypot(left.x_m, left.y_m) < 2e-3
    assert abs(left.phi_rad) < 2e-3


@names
def test_a_reference_is_reached_from_far_off_and_from_behind(name):
    left = settle(name, Drive(0.4, 0.0), PlanarError(-3.0, 4.0, 3.0), duration_s=90.0)
    assert math.hypot(left.x_m, left.y_m) < 2e-3
    assert abs(left.phi_rad) < 2e-3


@pytest.mark.parametrize("name", ["kanayama", "samson", "dynamic_feedback", "morin_samson"])
@pytest.mark.parametrize("omega_rps", [0.0, 0.3])
def test_at_rest_and_in_pure_rotation_the_heading_is_held(name, omega_rps):
    left = settle(name, Drive(0.0, omega_rps), PlanarError(0.0, 0.0, 1.0))
    assert abs(left.phi_rad) < 0.02
    assert math.hypot(left.x_m, left.y_m) < 0.05


@names
def test_a_reference_that_stops_and_reverses_is_followed_through(name):
    controller = open_controller(ALL_GAINS[name], LIMITS)
    robot = reference = Posture(0.0, 0.0, 0.0)
    for k in range(1200):
        drive = Drive(0.5 * math.cos(0.2 * k * DT_S), 0.0, -0.1 * math.sin(0.2 * k * DT_S))
        error = error_of(robot, reference)
        assert math.hypot(error.x_m, error.y_m) < 0.03
        assert abs(error.phi_rad) < 0.05
        robot = driven(robot, controller.steer(error, drive, DT_S), DT_S)
        reference = driven(reference, drive, DT_S)


# The two switches.


def test_beyond_its_range_the_law_of_morin_and_samson_turns_on_the_spot_towards_it():
    for phi_rad in np.linspace(TURN_FIRST_RAD + 1e-6, math.pi, 20):
        for sign in (1, -1):
            error = PlanarError(1.0, 2.0, sign * phi_rad)
            velocity = morin_samson(error, Drive(0.0, 0.0), MorinSamsonGains())
            assert velocity.v_mps == 0.0
            assert velocity.omega_rps * sign > SLOWEST_MPS


def test_dynamic_feedback_hands_over_near_rest_and_back_with_hysteresis():
    gains, still = DynamicFeedbackGains(), PlanarError(0.0, 0.0, 0.0)

    def slow_at(speed_mps, was_slow):
        momentum = Momentum(speed_mps, was_slow)
        return advance(still, Drive(speed_mps, 0.0), gains, momentum, LIMITS, DT_S)[1].slow

    between = gains.slowest_mps * (1 + RETURN_SHARE) / 2
    assert slow_at(0.9 * gains.slowest_mps, was_slow=False)
    assert not slow_at(between, was_slow=False)
    assert slow_at(between, was_slow=True)
    assert not slow_at(1.1 * RETURN_SHARE * gains.slowest_mps, was_slow=True)


@given(numbers(2), numbers(2), numbers(10))
def test_driving_forwards_and_the_same_arc_backwards_is_coming_home(v_mps, omega_rps, dt_s):
    start = Posture(1.0, -2.0, 0.7)
    drive = Drive(v_mps, omega_rps)
    home = driven(driven(start, drive, dt_s), drive, -dt_s)
    error = error_of(start, home)
    np.testing.assert_allclose([error.x_m, error.y_m, error.phi_rad], 0.0, atol=1e-9)
