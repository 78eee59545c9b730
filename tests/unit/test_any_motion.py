"""Wheels around a target that does whatever it likes: it stops, reverses, spins on the spot."""

import math

import numpy as np
import pytest

from services.camera.controllers.open import open_controller
from services.camera.controllers.planar import Drive, Posture, Velocity, driven, error_of
from services.camera.unicycle import UnicycleSettings
from services.kernels.rigid import planar
from services.planner.ease import ease
from services.planner.motion import Motion
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.wheels import open_carrier

pytestmark = pytest.mark.unit

DT_S, NUM, RADIUS_M = 1 / 15, 3, 0.8
CONTROLLERS = ["kanayama", "samson", "morin_samson", "dynamic_feedback", "input_output"]
CIRCLE = Circle(
    CircleSettings(cameras=NUM, radius_m=RADIUS_M, elevation_rad=0.0, centre_height_m=0.2)
)
FAREWELL_S = 30.0
"""At the end it drives on, so that everybody can catch up."""

SPIN = [(-0.125, 0.5625, 4.0)]
"""Nearly on the spot: the places swing by faster than anything on wheels."""


def some_legs(seed):
    """Draw speeds, turn rates and durations; every other speed or turn rate is none at all."""
    rng = np.random.default_rng(seed)
    rates = rng.uniform(-0.6, 0.6, (rng.integers(1, 7), 2))
    rates *= rng.integers(0, 2, rates.shape)
    return [(float(v), float(omega), rng.uniform(0.3, 4.0)) for v, omega in rates]


def motion(legs):
    """Yield the target's motion at every tick: from leg to leg at minimum jerk."""
    here, v, omega = Posture(0.0, 0.0, 0.3), 0.0, 0.0
    for v_next, omega_next, lasting_s in [*legs, (0.5, 0.1, FAREWELL_S)]:
        v_before, omega_before = v, omega
        for tick in range(math.ceil(lasting_s / DT_S)):
            share = ease(min(1.0, tick * DT_S / min(lasting_s, 2.0)))[0]
            v = v_before + share * (v_next - v_before)
            omega = omega_before + share * (omega_next - omega_before)
            heading = np.array([math.cos(here.phi_rad), math.sin(here.phi_rad), 0.0])
            T = planar(here.x_m, here.y_m, here.phi_rad)
            yield Motion(T, v * heading, np.array([0.0, 0.0, omega]))
            here = driven(here, Velocity(v, omega), DT_S)


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("legs", [*(some_legs(seed) for seed in range(8)), SPIN])
def test_whatever_the_target_does_all_is_finite_and_who_was_left_behind_comes_back(
    controller, legs
):
    wheels, told = open_carrier("unicycle"), UnicycleSettings(controller=controller)
    steering = [open_controller(told.gains(), told) for _ in range(NUM)]
    robots, errors = [], []
    for tick, target in enumerate(motion(legs)):
        t_s = tick * DT_S
        mounted = wheels.carry(range(NUM), CIRCLE.plan(target, t_s).views, target, t_s)
        references = [
            Posture(*view.T[:2, 3].tolist(), robot.heading_rad) for view, robot in mounted
        ]
        robots = robots or references
        errors.append([])
        for row, (_, robot) in enumerate(mounted):
            drive = Drive(robot.v_mps, robot.omega_rps, robot.v_dot)
            assert np.isfinite([robot.heading_rad, *vars(drive).values()]).all()
            velocity = steering[row].steer(error_of(robots[row], references[row]), drive, DT_S)
            assert abs(velocity.v_mps) <= told.max_speed_mps
            assert abs(velocity.omega_rps) <= told.max_turn_rps
            errors[-1].append(
                math.hypot(
                    robots[row].x_m - references[row].x_m, robots[row].y_m - references[row].y_m
                )
            )
            robots[row] = driven(robots[row], velocity, DT_S)
    errors_m = np.array(errors)
    assert np.isfinite(errors_m).all()
    assert errors_m.max() < 3 * RADIUS_M  # A spin swings the places faster than wheels turn.
    assert errors_m[-15:].max() < 1e-3
