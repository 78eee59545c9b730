"""The track tells where the target was at an instant, waits for what may come, forgets the rest."""

import numpy as np
import pytest

from schemas.geometry import Pose, Twist
from schemas.target import TargetPose
from services.kernels.rigid import integrate_twist, planar
from services.mapper.target_track import TargetTrack

pytestmark = pytest.mark.unit

DT_NS = 66_666_667
LINEAR, ANGULAR = (0.3, -0.2, 0.0), (0.0, 0.0, 0.7)


def matrix_at(tick: int) -> np.ndarray:
    """T_world_target of a target that moves with a constant twist."""
    return integrate_twist(planar(0.4, 0.1, 0.5), LINEAR, ANGULAR, tick * DT_NS * 1e-9)


def pose_at(tick: int, x_m: float | None = None) -> TargetPose:
    T = matrix_at(tick)
    T[0, 3] = T[0, 3] if x_m is None else x_m
    pose, twist = Pose.from_matrix(T), Twist(linear=LINEAR, angular=ANGULAR)
    return TargetPose(t_ns=tick * DT_NS, tick=tick, frame_id="world", pose=pose, twist=twist)


def track_of(*ticks: int) -> TargetTrack:
    track = TargetTrack()
    for tick in ticks:
        track.add(pose_at(tick))
    return track


def assert_pose(T: np.ndarray | None, expected: np.ndarray) -> None:
    assert T is not None
    np.testing.assert_allclose(T, expected, atol=1e-12)


def test_an_empty_track_knows_nothing_and_guesses_nothing() -> None:
    assert TargetTrack().at(0, 0) is None
    assert TargetTrack().at(0, 0, guess=True) is None


def test_every_tick_kept_has_its_own_pose_in_whatever_order_it_is_asked_for() -> None:
    track = track_of(*range(10))
    for tick in np.random.default_rng(0).permutation(10):
        assert_pose(track.at(int(tick), 0), matrix_at(int(tick)))


def test_a_tick_that_may_still_come_is_waited_for() -> None:
    track = track_of(3, 4)
    assert track.at(5, 5 * DT_NS) is None
    track.add(pose_at(5))
    assert_pose(track.at(5, 5 * DT_NS), matrix_at(5))


@pytest.mark.parametrize("ahead", [1, 2, 7])
def test_a_guess_carries_the_newest_pose_forward_by_its_twist(ahead: int) -> None:
    tick = 4 + ahead
    assert_pose(track_of(3, 4).at(tick, tick * DT_NS, guess=True), matrix_at(tick))


@pytest.mark.parametrize(("tick", "nearest"), [(3, 2), (7, 8), (1, 2)])
def test_a_tick_passed_over_is_carried_from_the_nearest(tick: int, nearest: int) -> None:
    track = TargetTrack()
    for known in (2, 8):
        # Each pose has an x of its own, so that it shows who was carried.
        track.add(pose_at(known, x_m=float(known)))
    expected = matrix_at(tick)
    expected[0, 3] = nearest + LINEAR[0] * (tick - nearest) * DT_NS * 1e-9
    assert_pose(track.at(tick, tick * DT_NS), expected)


def test_a_pose_told_twice_is_the_one_told_last() -> None:
    track = track_of(1, 2)
    track.add(pose_at(2, x_m=9.0))
    T = track.at(2, 2 * DT_NS)
    assert T is not None
    assert T[0, 3] == 9.0
    assert_pose(track.at(1, DT_NS), matrix_at(1))


def test_going_back_in_time_begins_a_new_run() -> None:
    track = track_of(100, 101)
    track.add(pose_at(0, x_m=7.0))
    assert track.at(1, DT_NS) is None
    T = track.at(101, 0, guess=True)
    assert T is not None
    assert T[0, 3] == pytest.approx(7.0)


def test_a_long_run_is_remembered_for_its_last_four_seconds_alone() -> None:
    track = TargetTrack()
    for tick in range(1000):
        track.add(pose_at(tick, x_m=float(tick)))
    # Asked for at time zero, a pose that is kept is given as it is; any other is extrapolated.
    kept = [t for t in range(1000) if (T := track.at(t, 0)) is not None and T[0, 3] == t]
    assert kept == list(range(936, 1000))
