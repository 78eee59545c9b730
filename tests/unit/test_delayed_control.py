"""A robot that is told late where it is, and its field of view."""

import math

import numpy as np
import pytest

from services.camera.controllers.delayed import predicted
from services.camera.controllers.planar import Posture, Velocity, driven
from tests.enclosing import (
    ALL_GAINS,
    BETA_RAD,
    DT_S,
    KAPPA_MAX,
    NUM_ROBOTS,
    lap,
    track,
)

pytestmark = pytest.mark.unit

DELAY_S = 0.1
NOISE_M, NOISE_RAD = 0.02, 0.006


def margin_rad(references, radius_m):
    """The margin rule: turning and driving during the delay, and three sigma of the bearing."""
    moved = np.abs(references.omega_rps) + np.abs(references.v_mps) / radius_m
    return moved.max() * DELAY_S + 3 * math.hypot(NOISE_RAD, NOISE_M / radius_m)


def radius_with_margin():
    """Largest radius at which the reference keeps the margin from the edge of the view."""
    radius_m = math.sin(BETA_RAD) / KAPPA_MAX
    for _ in range(10):
        margin = margin_rad(lap(radius_m)[0], radius_m)
        radius_m = math.sin(BETA_RAD - margin) / KAPPA_MAX
    return radius_m


@pytest.mark.parametrize("name", ALL_GAINS)
def test_with_the_margin_the_target_is_in_view_always_despite_noise_and_delay(name):
    references, target_m = lap(radius_with_margin())
    for robot in range(NUM_ROBOTS):
        rng = np.random.default_rng([7, robot])
        done = track(
            references,
            target_m,
            robot,
            ALL_GAINS[name],
            delay_s=DELAY_S,
            noise=lambda rng=rng: rng.normal(size=3) * (NOISE_M, NOISE_M, NOISE_RAD),
        )
        assert (np.abs(done.bearing_rad) <= BETA_RAD).all()
        assert math.sqrt((done.error_m**2).mean()) < 8e-3


def test_without_the_margin_the_same_noise_loses_the_target():
    references, target_m = lap(math.sin(BETA_RAD) / KAPPA_MAX)
    lost = 0
    for robot in range(NUM_ROBOTS):
        rng = np.random.default_rng([7, robot])
        done = track(
            references,
            target_m,
            robot,
            ALL_GAINS["kanayama"],
            delay_s=DELAY_S,
            noise=lambda rng=rng: rng.normal(size=3) * (NOISE_M, NOISE_M, NOISE_RAD),
        )
        lost += (np.abs(done.bearing_rad) > BETA_RAD).sum()
    assert lost > 0


@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.1, 0.12, 1.0])
def test_a_prediction_drives_the_last_commands_again(delay_s):
    rng = np.random.default_rng(3)
    commands = [Velocity(*rng.normal(size=2)) for _ in range(4)]
    path = [Posture(0.3, 0.2, 0.1)]
    num_fine = 1000
    for command in commands:
        for _ in range(num_fine):
            path.append(driven(path[-1], command, DT_S / num_fine))
    # Before the first command it stood still.
    ago = min(round(delay_s / DT_S * num_fine), len(path) - 1)
    here = predicted(path[-1 - ago], commands, delay_s, DT_S)
    np.testing.assert_allclose(
        [here.x_m, here.y_m, here.phi_rad],
        [path[-1].x_m, path[-1].y_m, path[-1].phi_rad],
        atol=1e-9,
    )
