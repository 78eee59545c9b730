"""The world advances by integer ticks and exact integration."""

import numpy as np
import pytest

from services.kernels.rigid import integrate_twist, look_at, pose_error
from services.simulator.actuator import Actuator
from services.simulator.clock import Clock
from services.simulator.messages import sim_state
from services.simulator.settings import SimulatorSettings
from services.simulator.world_state import World
from services.world.path import open_motion

pytestmark = pytest.mark.unit

DT_NS = 66_666_667


def world(speed=3.0, turn=4.0):
    return World(open_motion("ellipse", (1.6, 1.2), 40.0), DT_NS, Actuator(speed, turn))


def test_time_is_the_tick_times_dt_to_the_nanosecond():
    w = world()
    for _ in range(1000):
        w.advance({})
    assert w.t_ns == 1000 * DT_NS
    assert w.target() == w.motion.at(1000 * DT_NS * 1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_a_camera_flies_its_command_and_then_stands(seed):
    rng, w = np.random.default_rng(seed), world()
    T, twist = look_at(rng.normal(size=3), [0, 0, 0]), rng.uniform(-1, 1, 6)
    w.spawn(3, T)
    w.advance({3: twist})
    expected = integrate_twist(T, twist[:3], twist[3:], DT_NS * 1e-9)
    np.testing.assert_allclose(w.cameras[3].T_world_camera, expected, atol=1e-12)
    np.testing.assert_array_equal(w.cameras[3].twist, twist)
    w.advance({})
    np.testing.assert_allclose(w.cameras[3].T_world_camera, expected, atol=1e-12)
    assert not w.cameras[3].twist.any()
    assert w.num_clipped == 0


def test_a_command_above_the_limits_is_shortened_in_its_direction_and_counted():
    w = world(speed=2.0, turn=1.0)
    T = look_at([1, 0, 0.5], [0, 0, 0.2])
    w.spawn(0, T)
    w.advance({0: np.array([30.0, 40.0, 0.0, 0.0, 0.0, -9.0])})
    np.testing.assert_allclose(w.cameras[0].twist, [1.2, 1.6, 0, 0, 0, -1.0])
    assert w.num_clipped == 1
    metres, radians = pose_error(T, w.cameras[0].T_world_camera)
    assert metres == pytest.approx(2.0 * DT_NS * 1e-9)
    assert radians == pytest.approx(1.0 * DT_NS * 1e-9)


def test_a_camera_spawns_once_and_a_command_for_none_is_ignored():
    w = world()
    first = look_at([1, 0, 0.5], [0, 0, 0.2])
    w.spawn(0, first)
    w.spawn(0, look_at([2, 0, 0.5], [0, 0, 0.2]))
    w.advance({5: np.ones(6)})
    np.testing.assert_allclose(w.cameras[0].T_world_camera, first, atol=1e-12)
    assert list(w.cameras) == [0]
    w.reset()
    assert (w.tick, w.cameras) == (0, {})


def test_the_state_that_is_told_is_the_state_that_is():
    w, spec = world(), SimulatorSettings(object="box").scene(0)
    for camera in (2, 0):
        w.spawn(camera, look_at([1 + camera, 0, 0.5], [0, 0, 0.2]))
    for _ in range(7):
        w.advance({2: np.arange(6) / 10})
    state = sim_state(w, Clock(True, set(), None), spec)
    assert (state.tick, state.t_ns, state.dt_ns) == (7, 7 * DT_NS, DT_NS)
    np.testing.assert_allclose(state.target.matrix(), w.target().pose(), atol=1e-12)
    assert [body.camera for body in state.cameras] == [0, 2]
    T = state.cameras[1].pose.matrix()
    np.testing.assert_allclose(T, w.cameras[2].T_world_camera, atol=1e-12)
    assert state.cameras[1].twist.angular == pytest.approx((0.3, 0.4, 0.5))
