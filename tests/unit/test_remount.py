"""A change of drive while everything moves."""

from itertools import pairwise

import numpy as np
import pytest

from services.kernels.rigid import pose_error, rotation_log
from services.planner.motion import Motion
from services.planner.remount import DURATION_S, Remount
from services.planner.strategies.circle import Circle, CircleSettings
from services.planner.wheels import open_carrier
from services.world.path import open_motion

pytestmark = pytest.mark.unit

DT_S = 0.01
CAMERAS = tuple(range(6))
CIRCLE = Circle(CircleSettings(cameras=6, radius_m=1.2, elevation_rad=0.3, centre_height_m=0.2))
PATH = open_motion("ellipse", (4.0, 3.2), 60.0)
CHANGES_AT_S = 2.0
WAYS = pytest.mark.parametrize(("one", "other"), [("flying", "unicycle"), ("unicycle", "flying")])


def target_at(t_s):
    state = PATH.at(t_s)
    linear, angular = state.twist()
    return Motion(state.pose(), np.array(linear), np.array(angular))


def carried(carrier, t_s):
    target = target_at(t_s)
    return carrier.carry(CAMERAS, CIRCLE.plan(target, t_s).views, target, t_s)


def through_a_change(one, other):
    """Return what the cameras are told from before the change until after it, tick by tick."""
    carrier, told = open_carrier(one), []
    for k in range(round((CHANGES_AT_S + 2 * DURATION_S) / DT_S)):
        t_s = k * DT_S
        if k == round(CHANGES_AT_S / DT_S):
            carrier = Remount(carrier, open_carrier(other))
        told.append(carried(carrier, t_s))
    return told


@WAYS
def test_no_reference_jumps_and_each_turns_as_it_says(one, other):
    told = through_a_change(one, other)
    turns = []
    for before, after in pairwise(told[50:]):
        for a, b in zip(before, after, strict=True):
            turn = rotation_log(b.view.T[:3, :3] @ a.view.T[:3, :3].T) / DT_S
            # Robots' rates are smoothed differences: true to some hundredths.
            middle = (a.view.angular + b.view.angular) / 2
            np.testing.assert_allclose(turn, middle, atol=0.03)
            turns.append(np.linalg.norm(turn))
    assert 0.2 < max(turns) < 1.5


@WAYS
def test_after_the_change_all_is_as_if_it_had_always_been_so(one, other):
    last = through_a_change(one, other)[-1]
    assert [each.robot is None for each in last] == [other == "flying"] * 6
    for each in last:
        if each.robot is None:
            target = target_at(CHANGES_AT_S + 2 * DURATION_S - DT_S)
            views = CIRCLE.plan(target, 0.0).views
            assert min(pose_error(each.view.T, view.T) for view in views) < (1e-6, 1e-6)


def test_a_world_that_is_reset_during_the_change_begins_with_the_new_drive():
    carrier = Remount(open_carrier("unicycle"), open_carrier("flying"))
    carried(carrier, 3.0)
    views = CIRCLE.plan(target_at(0.0), 0.0).views
    for view, each in zip(views, carried(carrier, 0.0), strict=True):
        np.testing.assert_array_equal(each.view.T, view.T)
