"""The launcher's word on how well the target was known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.geometry import Pose, Twist
from schemas.target import TargetEstimate, TargetPose
from services.kernels.rigid import planar
from services.launcher.target_error import TargetErrors

pytestmark = pytest.mark.unit

STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))


def truth(tick, x=0.0, phi=0.0):
    pose = Pose.from_matrix(planar(x, 0, phi))
    return TargetPose(t_ns=tick, tick=tick, frame_id="world", pose=pose, twist=STILL)


def estimate(tick, x=0.0, phi=0.0, **counts):
    return TargetEstimate(
        **truth(tick, x, phi).model_dump(exclude={"pose"}),
        pose=Pose.from_matrix(planar(x, 0, phi)),
        sigma_m=0.0,
        sigma_rad=0.0,
        **({"num_used": tick + 1, "num_refused": 0, "num_missed": 0} | counts),
    )


@given(st.permutations(range(20)))
def test_the_order_in_which_truths_and_estimates_come_does_not_matter(order):
    errors = TargetErrors()
    for each in order:
        if each < 10:
            errors.add_truth(truth(each, x=1.0))
        else:
            errors.add_estimate(estimate(each - 10, x=1.0 + 0.01 * (each - 9)))
    told = errors.report()
    assert told["instants"] == 10
    assert told["place_m"]["max"] == pytest.approx(0.1)
    assert told["place_m"]["rms"] == pytest.approx(0.01 * math.sqrt(38.5))


@given(st.floats(-np.pi, np.pi), st.floats(-3, 3))
def test_headings_differ_the_short_way_round(phi, turn):
    errors = TargetErrors()
    errors.add_truth(truth(0, phi=phi))
    errors.add_estimate(estimate(0, phi=phi + turn, num_refused=2, num_missed=3))
    told = errors.report()
    assert told["heading_rad"]["max"] == pytest.approx(abs(turn), abs=1e-9)
    assert (told["used"], told["refused"], told["missed"]) == (1, 2, 3)


def test_where_nothing_was_estimated_nothing_is_said_and_little_kept():
    errors = TargetErrors()
    for tick in range(1000):
        errors.add_truth(truth(tick))
    assert errors.report() is None
    assert len(errors.truths) < 100
