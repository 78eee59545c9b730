"""One valid example of every message, fixed for ever: the golden files are made of these."""

import numpy as np

from schemas.camera import (
    CameraCommand,
    CameraGoal,
    CameraInfo,
    CameraPose,
    CloudHeard,
    ColorImage,
    Intrinsics,
    RobotGoal,
)
from schemas.cloud import DepthCloud, XyzCloud
from schemas.feasibility import Feasibility, RobotNeeds, Rule
from schemas.formation import Formation, Reference
from schemas.geometry import Pose, Twist
from schemas.map import MapChanges, MapFull, MapSummary
from schemas.message import Envelope, Message
from schemas.metrics import Missing, Quality, Score
from schemas.sim import CameraBody, DeformationSpec, SceneSpec, SimClock, SimState
from schemas.status import ServiceStatus, StageStatus, TopicStatus
from schemas.target import Sighting, TargetEstimate, TargetObservation, TargetPose
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_COMMAND,
    CAMERA_GOAL,
    CAMERA_INFO,
    CAMERA_POSE,
    CLOUD_HEARD,
    FORMATION,
    MAP_CHANGES,
    MAP_FULL,
    MAP_SUMMARY,
    QUALITY,
    SERVICE_STATUS,
    SIM_CLOCK,
    SIM_STATE,
    TARGET_ESTIMATE,
    TARGET_OBSERVATION,
    TARGET_POSE,
    Topic,
)

ENVELOPE = Envelope(seq=41, src="camera/3", boot="5e1f", t_pub_ns=1_700_000_000_000_000_000)

_STAMP = {"t_ns": 2_000_000_000, "tick": 30, "frame_id": "world"}
_POSE = Pose(position=(1.0, -2.0, 0.5), orientation=(0.5, -0.5, 0.5, 0.5))
_TWIST = Twist(linear=(0.1, 0.2, 0.0), angular=(0.0, 0.0, -0.3))
_OPTICS = Intrinsics(width=4, height=3, fx=5.0, fy=5.0, cx=1.5, cy=1.0)
_SHOT = {"camera": 3, "pose": _POSE, "max_range_m": 5.0, "t_capture_ns": 17}
_MAP = {
    "rev": 8,
    "resolution_m": 0.01,
    "origin": (-0.6, -0.6, -0.1),
    "shape_voxels": (120, 120, 80),
    "pose": _POSE,
}
_SCORE = Score(
    tolerance_m=0.02,
    coverage=0.75,
    coverage_observable=0.875,
    coverage_visible=1.0,
    precision=0.5,
    f_score=0.6,
    ghost_rate=0.5,
)

EXAMPLES: dict[str, tuple[Topic[Message], Message]] = {
    "target_pose": (TARGET_POSE, TargetPose(**_STAMP, pose=_POSE, twist=_TWIST)),
    "target_observation": (
        TARGET_OBSERVATION,
        TargetObservation(
            **_STAMP,
            sighting=Sighting(t_ns=1_900_000_000, pose=_POSE, sigma_m=0.02, sigma_rad=0.006),
        ),
    ),
    "target_estimate": (
        TARGET_ESTIMATE,
        TargetEstimate(
            **_STAMP,
            pose=_POSE,
            twist=_TWIST,
            sigma_m=0.01,
            sigma_rad=0.02,
            num_used=28,
            num_refused=1,
            num_missed=2,
        ),
    ),
    "camera_goal": (CAMERA_GOAL, CameraGoal(**_STAMP, camera=3, pose=_POSE, twist=_TWIST)),
    "camera_goal_of_a_unicycle": (
        CAMERA_GOAL,
        CameraGoal(
            **_STAMP,
            camera=3,
            pose=_POSE,
            twist=_TWIST,
            robot=RobotGoal(
                heading_rad=0.5,
                v_mps=0.25,
                omega_rps=-0.3,
                v_dot=0.125,
                camera_yaw_rad=-2.0,
            ),
        ),
    ),
    "camera_pose": (CAMERA_POSE, CameraPose(**_STAMP, camera=3, pose=_POSE, twist=_TWIST)),
    "cloud_heard": (CLOUD_HEARD, CloudHeard(**_STAMP, camera=3)),
    "camera_command": (CAMERA_COMMAND, CameraCommand(**_STAMP, camera=3, twist=_TWIST)),
    "camera_info": (
        CAMERA_INFO,
        CameraInfo(
            **_STAMP,
            camera=3,
            intrinsics=_OPTICS,
            depth_scale_m=0.001,
            min_range_m=0.1,
            max_range_m=5.0,
            baseline_m=0.05,
            noise="nguyen",
        ),
    ),
    "depth_cloud": (
        CAMERA_CLOUD,
        DepthCloud.of(
            np.arange(12, dtype="<u2").reshape(3, 4),
            **_STAMP,
            **_SHOT,
            intrinsics=_OPTICS,
            depth_scale_m=0.001,
        ),
    ),
    "xyz_cloud": (
        CAMERA_CLOUD,
        XyzCloud.of(np.arange(6, dtype="<f4").reshape(2, 3), **_STAMP, **_SHOT),
    ),
    "color_image": (
        CAMERA_COLOR,
        ColorImage.of(np.arange(9, dtype="|u1"), **_STAMP, camera=3, width=4, height=3),
    ),
    "formation": (
        FORMATION,
        Formation(
            **_STAMP,
            strategy="circle",
            centre=(0.0, 0.0, 0.2),
            radius_m=1.1,
            references=(Reference(camera=3, pose=_POSE, twist=_TWIST),),
            polygon=((1.0, 0.0, 0.2),),
        ),
    ),
    "formation_with_feasibility": (
        FORMATION,
        Formation(
            **_STAMP,
            strategy="circle",
            centre=(0.0, 0.0, 0.2),
            radius_m=1.1,
            references=(Reference(camera=3, pose=_POSE, twist=_TWIST),),
            polygon=((1.0, 0.0, 0.2),),
            feasibility=Feasibility(
                feasible=False,
                kappa_max_1pm=0.5,
                critical_scale_m=1.0,
                finite_set_scale_m=1.25,
                least_scale_m=None,
                greatest_scale_m=None,
                robots_apart_m=None,
                target_apart_m=1.5,
                rules=(
                    Rule(
                        name="field of view",
                        inequality="max |beta_ri| + beta_R <= beta",
                        sense="<=",
                        value=0.75,
                        limit=0.5,
                        unit="rad",
                        holds=False,
                    ),
                ),
                robots=(
                    RobotNeeds(
                        theta_rad=-1.0,
                        bearing_rad=0.75,
                        margin_rad=-0.25,
                        share_in_view=0.5,
                        v_min_mps=0.25,
                        v_max_mps=0.5,
                        omega_rps=0.125,
                    ),
                ),
            ),
        ),
    ),
    "map_changes": (
        MAP_CHANGES,
        MapChanges.of(np.array([[1, 2, 3, 2]], dtype="<i2"), **_STAMP, **_MAP, base_rev=7),
    ),
    "map_full": (
        MAP_FULL,
        MapFull.of(np.full((1, 515), -32768, dtype="<i2"), **_STAMP, **_MAP),
    ),
    "map_summary": (
        MAP_SUMMARY,
        MapSummary(
            **_STAMP,
            rev=8,
            cameras_used=(0, 1, 3),
            cameras_missing=(2,),
            num_returns=1000,
            num_occupied=100,
            num_free=5000,
            num_changed=60,
            fuse_ms=12.5,
            latency_ms=30.0,
            entropy_bits=4000.0,
            late_clouds=1,
            memory="instant",
        ),
    ),
    "quality": (
        QUALITY,
        Quality(
            **_STAMP,
            rev=8,
            stamp_true=(_SCORE, _SCORE),
            latency_true=(_SCORE, _SCORE),
            lag_ticks=1,
            missing=Missing(out_of_view=0.1, self_occluded=0.1, grazing=0.04, not_yet_updated=0.01),
            accuracy_m=0.004,
            completeness_m=0.006,
            chamfer_m=0.005,
            num_samples=10_000,
            num_voxels=4000,
            skipped_instants=2,
        ),
    ),
    "service_status": (
        SERVICE_STATUS,
        ServiceStatus(
            **_STAMP,
            service="camera",
            instance="3",
            pid=4711,
            uptime_s=12.0,
            cpu_s=3.5,
            rss_bytes=123_456_789,
            shm_used=True,
            bad_messages=1,
            bad_reason="cams/3/goal: tick: Field required",
            topics=(
                TopicStatus(
                    key="cams/3/cloud",
                    sent=True,
                    count=30,
                    rate_hz=14.9,
                    declared_hz=15.0,
                    alive=True,
                    rate_ok=True,
                    lost=0,
                    bad=0,
                    shared_memory=29,
                ),
            ),
            stages=(StageStatus(name="render", count=30, total_s=0.1, p50_ms=3.0, p95_ms=4.0),),
        ),
    ),
    "service_status_with_version": (
        SERVICE_STATUS,
        ServiceStatus(
            **_STAMP,
            service="mapper",
            instance="0",
            version="0.1.0",
            host="robot-3",
            pid=4712,
            uptime_s=12.0,
            cpu_s=3.5,
            rss_bytes=123_456_789,
            shm_used=None,
            bad_messages=0,
            topics=(),
            stages=(),
        ),
    ),
    "sim_clock": (
        SIM_CLOCK,
        SimClock(
            **_STAMP,
            dt_ns=66_666_667,
            mode="lockstep",
            state="running",
            waiting_for=("camera/3",),
            dropped=("camera/5",),
            overruns=2,
            t_wall_ns=1_700_000_000_000_000_000,
        ),
    ),
    "sim_state": (
        SIM_STATE,
        SimState(
            **_STAMP,
            dt_ns=66_666_667,
            mode="lockstep",
            target=_POSE,
            twist=_TWIST,
            scene=SceneSpec(
                object="bunny",
                height_m=0.4,
                subdivide=2,
                deformations=(
                    DeformationSpec(kind="squash", amplitude=0.2, hz=0.5, phase_rad=0.0),
                ),
                seed=7,
            ),
            cameras=(CameraBody(camera=3, pose=_POSE, twist=_TWIST),),
        ),
    ),
}
"""Name of the golden file: the topic it travels on, and the message."""
