"""On wheels a change of the formation turns no robot's course aside beyond what it can see."""

import numpy as np
import pytest

from services.kernels.rigid import planar
from services.planner.director import Director
from services.planner.formation import FormationSettings
from services.planner.motion import Motion
from services.planner.wheels import open_carrier

pytestmark = pytest.mark.unit

RATE_HZ = 15


def target_at(t_s, v_mps, omega_rps):
    phi = omega_rps * t_s
    x, y = (v_mps * t_s, 0.0)
    if omega_rps:
        x, y = np.array([np.sin(phi), 1 - np.cos(phi)]) * v_mps / omega_rps
    ahead = np.array([np.cos(phi), np.sin(phi), 0.0])
    return Motion(planar(x, y, phi), v_mps * ahead, np.array([0.0, 0.0, omega_rps]))


def steps_through(change, v_mps, omega_rps):
    """Return how far, rad, robots turn in a tick at most, and the greatest turn rate told."""
    settings = FormationSettings(drive="unicycle", infeasible="allow", elevation_deg=0.0)
    director, carrier = Director(settings), open_carrier("unicycle")
    before, turned_rad, told_rps = {}, 0.0, 0.0
    for tick in range(30 * RATE_HZ):
        t_s = tick / RATE_HZ
        target = target_at(t_s, v_mps, omega_rps)
        if t_s == 2.0:
            director.change(settings.changed(change))
        orders = director.plan(target, t_s)
        mounted = carrier.carry(orders.cameras, orders.views, target, t_s, orders.psi_rad)
        for camera, (_, robot) in zip(orders.cameras, mounted, strict=True):
            step = robot.heading_rad - before.get(camera, robot.heading_rad)
            turned_rad = max(turned_rad, abs(np.angle(np.exp(1j * step))))
            told_rps = max(told_rps, abs(robot.omega_rps))
            before[camera] = robot.heading_rad
    return turned_rad, told_rps


@pytest.mark.parametrize("change", [{"radius_m": 1.6}, {"radius_m": 0.9}, {"strategy": "rings"}])
@pytest.mark.parametrize(("v_mps", "omega_rps"), [(0.3, 0.1), (0.5, 0.0), (0.2, -0.1)])
def test_no_reference_turns_on_the_spot_or_about_in_a_change(change, v_mps, omega_rps):
    turned_rad, told_rps = steps_through(change, v_mps, omega_rps)
    assert turned_rad < np.radians(3.0)
    assert told_rps < 0.6
