"""Known motions: those of the simulated world, without knowing it."""

import numpy as np
import pytest

from services.planner.errors import PlannerError
from services.planner.known_motion import curvature, greatest_curvature, known_path
from services.planner.planar import PlanarMotion
from services.world.path import PATHS, open_motion

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("kind", PATHS)
def test_a_known_path_is_the_one_the_world_drives(kind):
    known = known_path(kind, (1.6, 1.2), 40.0, 33)
    world = open_motion(kind, (1.6, 1.2), 40.0)
    assert known.t_s[-1] == 40.0
    for index, t in enumerate(known.t_s):
        state, target = world.at(t), known.target
        expected = (*state.position_m, state.v_m_s, state.omega_rad_s, state.v_dot, state.omega_dot)
        ours = (
            target.x_m,
            target.y_m,
            target.v_mps,
            target.omega_rps,
            target.v_dot,
            target.omega_dot,
        )
        np.testing.assert_allclose([each[index] for each in ours], expected, atol=1e-12)
        turn = np.exp(1j * (target.phi_rad[index] - state.heading_rad))
        assert turn == pytest.approx(1)


def test_curvature_is_signed_and_defined_where_the_target_stands():
    motion = PlanarMotion(0, 0, 0, np.array([2.0, -2.0, 0.0, 0.0]), np.array([1.0, 1.0, 0.0, -1.0]))
    assert curvature(motion).tolist() == [0.5, -0.5, 0.0, -np.inf]
    assert greatest_curvature(motion) == np.inf


@pytest.mark.parametrize(
    "args", [((0, 1), 1, 9), ((1, -1), 1, 9), ((1, 1), np.nan, 9), ((1, 1), 1, 1)]
)
def test_a_path_without_extent_is_refused(args):
    with pytest.raises(PlannerError, match="must be positive and finite"):
        known_path("ellipse", *args)
