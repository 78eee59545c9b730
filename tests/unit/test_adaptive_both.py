"""Strategies B and D together: what the objective is worth, and that all is seen."""

import numpy as np
import pytest

from services.planner.errors import InfeasibleError
from services.planner.feasibility import check
from services.planner.known_motion import known_path
from services.planner.rules import Limits
from services.planner.strategies.adaptive_angles import adaptive_angles
from services.planner.strategies.adaptive_both import adaptive_both
from services.planner.strategies.adaptive_scale import adaptive_scale
from services.planner.whole_motion import plan_whole

pytestmark = [pytest.mark.unit, pytest.mark.slow]

SEEING = Limits(beta_rad=np.radians(30))
FEW = known_path("ellipse", (25.0, 12.6157), 200.0, 121)


def objective(slots, d_m, alpha):
    opening = np.mean(1 / d_m - 1 / np.asarray(slots.d_m))
    return alpha * opening - (1 - alpha) * np.mean(np.abs(slots.theta_rad - slots.theta_0_rad))


def test_both_at_once_open_farther_than_scale_alone_and_see_it_always():
    both = adaptive_both(FEW, 5, 3.18, SEEING, alpha=1.0)
    alone = adaptive_scale(FEW, 5, 3.18, SEEING)
    assert check(FEW.target, both, SEEING).feasible
    assert objective(both, 3.18, 1.0) > 1.2 * objective(alone, 3.18, 1.0)


def test_with_even_angles_alone_in_mind_it_moves_no_more_than_it_must():
    must = adaptive_angles(FEW, 3, 4.0, SEEING)
    both = adaptive_both(FEW, 3, 4.0, SEEING, alpha=0.0)
    assert objective(both, 4.0, 0.0) >= objective(must, 4.0, 0.0)


def test_the_more_the_scale_is_worth_the_farther_it_opens_and_the_more_they_move():
    plans = [adaptive_both(FEW, 3, 4.0, SEEING, alpha) for alpha in (0.0, 0.9)]
    opening = [objective(slots, 4.0, 1.0) for slots in plans]
    moving = [-objective(slots, 4.0, 0.0) for slots in plans]
    assert opening[0] < opening[1]
    assert moving[0] < moving[1]
    for slots in plans:
        assert check(FEW.target, slots, SEEING).feasible


def test_what_no_moves_can_mend_is_refused_by_both_as_by_angles_alone():
    with pytest.raises(InfeasibleError, match="however it moves on the circle"):
        adaptive_both(FEW, 5, 7.0, SEEING, alpha=0.5)


def test_a_closed_lap_ends_as_it_began_and_derivatives_are_derivatives():
    fine = known_path("ellipse", (25.0, 12.6157), 200.0, 1201)
    slots = adaptive_both(fine, 2, 3.5, SEEING, alpha=0.5)
    step = fine.t_s[1] - fine.t_s[0]
    for value, rate in (
        (slots.d_m, slots.d_dot),
        (slots.d_dot, slots.d_ddot),
        (slots.theta_rad, slots.theta_dot),
        (slots.theta_dot, slots.theta_ddot),
    ):
        np.testing.assert_allclose(value[-1], value[0], atol=1e-12)
        np.testing.assert_allclose(np.gradient(value, step, axis=0)[1:-1], rate[1:-1], atol=5e-3)


def test_its_refusal_names_the_nearest_scale():
    with pytest.raises(InfeasibleError, match=r"nearest feasible d = 6\.\d+ m"):
        plan_whole("adaptive_both", FEW, 3, 6.5, SEEING)
