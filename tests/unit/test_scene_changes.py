"""A scene that changes: the truth of each is kept, and a camera flies or drives as it is told."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from schemas.camera import CameraGoal, RobotGoal
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody, SceneSpec
from services.camera.settings import CameraSettings
from services.evaluator.judge import Judge
from services.kernels.rigid import look_at
from services.world.deformation import parse_deformations

pytestmark = pytest.mark.unit

RIGID = SceneSpec(object="sphere", height_m=0.4, subdivide=0, deformations=(), seed=0)
BENT = RIGID.model_copy(update={"deformations": parse_deformations("bend:0.5:1")})
BOX = RIGID.model_copy(update={"object": "box"})
DT_S = 1 / 15


def judge():
    return Judge(radius_m=1.1, num_samples=500, seed=3)


def test_truths_of_scenes_that_take_turns_are_built_once():
    ours = judge()
    truths = {spec: ours.truth(spec) for spec in (RIGID, BOX, BENT)}
    for spec in (BENT, RIGID, BOX, RIGID):
        assert ours.truth(spec) is truths[spec]


def test_the_truth_in_use_is_never_the_one_that_is_let_go():
    ours = judge()
    used = ours.truth(RIGID)
    for height_m in np.linspace(0.2, 0.3, 6):
        ours.truth(BOX.model_copy(update={"height_m": float(height_m)}))
        assert ours.truth(RIGID) is used


def test_threads_that_need_the_same_truth_are_given_the_same():
    ours = judge()
    with ThreadPoolExecutor(4) as pool:
        truths = list(pool.map(ours.truth, [RIGID] * 4))
    assert len({id(truth) for truth in truths}) == 1


def test_another_deformation_keeps_the_samples_and_is_what_a_new_judge_builds():
    ours = judge()
    rigid, bent, fresh = ours.truth(RIGID), ours.truth(BENT), judge().truth(BENT)
    assert bent.observable is rigid.observable
    for t_s in (0.0, 0.1, 0.25):
        np.testing.assert_array_equal(bent.at(t_s).placed.points_m, fresh.at(t_s).placed.points_m)
    assert np.ptp(bent.at(0.25).placed.points_m - rigid.at(0.25).placed.points_m) > 0.01


def test_a_planned_pilot_flies_and_drives_like_those_that_can_do_one_alone():
    flying, driving, planned = (
        CameraSettings(drive=drive).pilot() for drive in ("flying", "unicycle", "planned")
    )
    still = Twist(linear=(0.1, 0.0, 0.0), angular=(0.0, 0.0, 0.0))
    T = look_at((1.0, 0.1, 0.5), (0.0, 0.0, 0.2))
    body = CameraBody(camera=0, pose=Pose.from_matrix(T), twist=still)
    robot = RobotGoal(heading_rad=0.1, v_mps=0.1, omega_rps=0, v_dot=0, camera_yaw_rad=2.0)
    there = Pose.from_matrix(look_at((1.02, 0.1, 0.52), (0.0, 0.0, 0.2)))
    goal = CameraGoal(t_ns=0, tick=4, frame_id="world", camera=0, pose=there, twist=still)
    driven = goal.model_copy(update={"robot": robot})
    assert planned.objection(goal) is planned.objection(driven) is None
    assert planned.command(body, 4, goal, DT_S) == flying.command(body, 4, goal, DT_S)
    assert planned.command(body, 4, driven, DT_S) == driving.command(body, 4, driven, DT_S)
    assert planned.command(body, 4, goal, DT_S) != planned.command(body, 4, driven, DT_S)
