"""Straight above the target there is no azimuth, and nothing jumps or races there all the same."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from services.kernels.rigid import apply, inverse, look_at, planar, rotation_log
from services.planner.director import Director
from services.planner.formation import FormationSettings
from services.planner.motion import Motion, stacked
from services.planner.overhead import Overhead, directions_of, tilts_of
from services.planner.view_file import format_views

pytestmark = pytest.mark.unit

DT_S, STEP_S = 1 / 30, 1e-5
HEIGHT_M = 0.2
MAX_SPEED_MPS, MAX_TURN_RPS = 2.0, 2.5  # What a camera's drive can do.
CHANGE_S, END_S = 2 * DT_S, 4.5

speeds = st.floats(0.05, 0.5)
turns = st.one_of(st.just(0.0), st.floats(-0.4, 0.4))
# From the vertical of the camera to where the target passes it, m: exactly, nearly, not quite.
misses = st.one_of(st.just(0.0), st.sampled_from((1e-12, 1e-9, -1e-6, 1e-4)), st.floats(-0.1, 0.1))
arms = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.9, 1)).filter(
    lambda arm: np.linalg.norm(arm) > max(0.1, -1.1 * arm[2])  # At the nadir tilts flip.
)


class Passing:
    """A target that drives along an arc and is at the origin, to a miss, at an instant."""

    def __init__(self, v_mps, omega_rps, miss_m, at_s):
        T = planar(0.0, miss_m, 0.0)
        self._there, self._at_s = Motion(T, v_mps * T[:3, 0], np.array([0, 0, omega_rps])), at_s

    def at(self, t_s):
        return self._there.predicted(t_s - self._at_s)


def test_tilts_are_undone_everywhere_but_at_the_nadir():
    rng = np.random.default_rng(4)
    arms = rng.normal(size=(200, 3))
    arms[0] = 0.0, 0.0, 1.0
    arms[1:100, :2] *= np.geomspace(1e-12, 0.1, 99)[:, None]
    arms[1:100, 2] = np.abs(arms[1:100, 2])
    directions = arms / np.linalg.norm(arms, axis=1)[:, None]
    np.testing.assert_allclose(directions_of(tilts_of(arms)), directions, atol=1e-12)


@given(arms, st.tuples(*3 * [st.floats(-1, 1)]))
@example(arm=(0.0, 0.0, 1.0), velocity=(0.3, -0.2, 0.1))
@example(arm=(1e-9, 0.0, 1.0), velocity=(0.3, -0.2, 0.1))
@example(arm=(1e-2, 1e-2, 1.0), velocity=(0.3, -0.2, 0.1))
def test_tilted_frames_move_as_the_places_do(arm, velocity):
    centre, arm, velocity = np.array([0.1, 0.2, 0.3]), np.array(arm), np.array(velocity)
    frames = []
    for t_s in (-STEP_S, 0.0, STEP_S):
        T = np.eye(4)[None]
        T[0, :3, 3] = centre + arm + t_s * velocity
        local = Motion(T, velocity[None], np.zeros((1, 3)))
        frames.append(Overhead.of(local, centre).tilted(centre))
        np.testing.assert_allclose(frames[-1].T[0, :3, 3], T[0, :3, 3], atol=1e-12)
    before, now, then = frames
    np.testing.assert_allclose(now.linear[0], velocity, atol=1e-8)
    turn = rotation_log(then.T[0, :3, :3] @ before.T[0, :3, :3].T) / (2 * STEP_S)
    np.testing.assert_allclose(now.angular[0], turn, atol=1e-5 / np.linalg.norm(arm) ** 3)


def rig(folder, roll_rad=0.4):
    """A view from straight above the origin, rolled, and two from the sides; as a file."""
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    above = np.array([[c, s, 0, 0], [s, -c, 0, 0], [0, 0, -1, 1.5], [0, 0, 0, 1.0]])
    sides = [look_at(np.array(eye), np.array([0, 0, HEIGHT_M])) for eye in SIDES]
    path = folder / "views.txt"
    path.write_text(format_views([above, *sides]))
    return path


SIDES = ((0.9, 0.0, 1.3), (-0.6, 0.8, 1.2))


@pytest.fixture(scope="module")
def view_file(tmp_path_factory):
    return rig(tmp_path_factory.mktemp("rig"))


def formation(strategy, view_file):
    with_file = {"view_file": view_file} if strategy in ("static", "dome") else {}
    if strategy == "dome":
        with_file["travel_s"] = 3.0  # 40 degrees from view to view.
    return {
        "strategy": strategy,
        "cameras": 3,
        "centre_height_m": HEIGHT_M,
        "elevation_deg": 30.0,
        "top_elevation_deg": 75.0,
        **with_file,
    }


def off_rad(view, centre):
    """How far the centre is from the middle of an image, as an angle."""
    seen = apply(inverse(view.T), centre)
    return np.arctan2(np.hypot(seen[0], seen[1]), seen[2])


CHANGES = [
    ("static", "circle"),
    ("circle", "static"),
    ("static", "rings"),
    ("dome", "circle"),
    ("static", "sphere"),
    ("static", "dome"),
]


@pytest.mark.parametrize(("old", "new"), CHANGES)
@settings(max_examples=4, deadline=None)
@given(speeds, turns, misses, st.floats(0.0, 2.0))
@example(v_mps=0.3, omega_rps=0.0, miss_m=0.0, late_s=0.0)
@example(v_mps=0.3, omega_rps=0.0, miss_m=0.0, late_s=1.0)
@example(v_mps=0.3, omega_rps=0.2, miss_m=1e-6, late_s=1.0)
def test_a_target_passes_below_a_camera_and_no_reference_jumps_or_races(
    view_file, old, new, v_mps, omega_rps, miss_m, late_s
):
    target = Passing(v_mps, omega_rps, miss_m, CHANGE_S + late_s)
    director = Director(FormationSettings(**formation(old, view_file)))
    former = Director(FormationSettings(**formation(old, view_file)))
    latter = Director(FormationSettings(**formation(new, view_file)))
    last, changed = None, False
    for t_s in np.arange(0.0, END_S, DT_S):
        if t_s >= CHANGE_S and not changed:
            director.change(director.formation.changed(formation(new, view_file)))
            changed = True
        there = target.at(t_s)
        orders = director.plan(there, t_s)
        now = dict(zip(orders.cameras, orders.views, strict=True))
        centre = apply(there.T, np.array([0, 0, HEIGHT_M]))
        allowed = [off_rad(v, centre) for d in (former, latter) for v in d.plan(there, t_s).views]
        for camera, view in now.items():
            for part in (view.T, view.linear, view.angular):
                assert np.isfinite(part).all()
            assert off_rad(view, centre) <= max(allowed) + 1e-6
            assert np.linalg.norm(view.linear) <= MAX_SPEED_MPS
            assert np.linalg.norm(view.angular) <= MAX_TURN_RPS
            if last is not None:
                before = last[camera].T
                step = np.linalg.norm(view.T[:3, 3] - before[:3, 3])
                turn = np.linalg.norm(rotation_log(view.T[:3, :3] @ before[:3, :3].T))
                assert step <= MAX_SPEED_MPS * DT_S
                assert turn <= MAX_TURN_RPS * DT_S
        last = now
    # All are where the new formation wants them.
    want = stacked(latter.plan(there, t_s).views).T[:, :3, 3]
    have = stacked(orders.views).T[:, :3, 3]
    apart = np.linalg.norm(want[:, None] - have[None], axis=2)
    assert apart.min(axis=1).max() < 1e-6
