"""Laws of what is remembered of the target's motion."""

import numpy as np
import pytest

from services.kernels.rigid import planar
from services.planner.known_motion import curvature, known_path
from services.planner.motion import Motion
from services.planner.seen_motion import SeenMotion
from services.planner.target_filter import Fix, TargetFilter, motion_of
from services.planner.target_settings import TargetSettings

pytestmark = pytest.mark.unit
DT_S = 1 / 15


def moving(v_mps, omega_rps):
    return Motion(planar(0.0, 0.0, 0.0), np.array([v_mps, 0, 0]), np.array([0, 0, omega_rps]))


@pytest.mark.parametrize("estimated", [False, True])
def test_a_turn_is_remembered_until_time_is_reset(estimated):
    seen = SeenMotion(estimated=estimated)
    for k in range(300):
        seen.saw(moving(0.5, 0.4 if 100 < k < 200 else 0.0), k * DT_S)
    assert seen.sharpest_1pm == pytest.approx(0.8, rel=0.01)
    assert len(list(seen.turns())) == 4
    seen.saw(moving(0.5, 0.1), 299 * DT_S - 0.1)  # Overtaken.
    assert seen.sharpest_1pm == pytest.approx(0.8, rel=0.01)
    seen.saw(moving(0.5, 0.0), 0.0)
    assert seen.sharpest_1pm == 0.0


def test_one_instant_of_an_estimate_is_not_believed():
    seen = SeenMotion(estimated=True)
    for k in range(300):
        seen.saw(moving(0.06, 0.3) if k in (2, 150) else moving(0.3, 0.1), k * DT_S)
    assert seen.sharpest_1pm < 1.3 / 3


@pytest.mark.parametrize("seed", range(4))
def test_of_a_filtered_target_the_sharpest_turn_is_its_own(seed):
    """2 cm and 6 mrad, one lap of the path of a run."""
    lap = known_path("ellipse", (1.6, 1.2), 40.0, num_instants=601).target
    noise = np.random.default_rng(seed)
    told = TargetSettings()
    target_filter = TargetFilter(told.target_agility(), told.bridge_s)
    seen = SeenMotion(estimated=True)
    for k in range(601):
        x_m, y_m = np.array([lap.x_m[k], lap.y_m[k]]) + 0.02 * noise.normal(size=2)
        phi_rad = lap.phi_rad[k] + 0.006 * noise.normal()
        target_filter.add(Fix(round(k * DT_S * 1e9), x_m, y_m, 0.02, phi_rad, 0.006))
        seen.saw(motion_of(target_filter.at(round((k + 1) * DT_S * 1e9))), k * DT_S)
    assert seen.sharpest_1pm == pytest.approx(np.abs(curvature(lap)).max(), rel=0.3)
