"""A recording of two real cameras and a real map, small enough to be made for a test."""

from pathlib import Path

import numpy as np

from schemas.camera import CameraInfo, CameraPose, ColorImage, Intrinsics
from schemas.cloud import DepthCloud
from schemas.codec import encode
from schemas.formation import Formation
from schemas.geometry import WORLD, Pose, Twist
from schemas.map import MapChanges
from schemas.message import Envelope
from schemas.metrics import Missing, Quality, Score
from schemas.sim import CameraBody, SceneSpec, SimState
from schemas.target import TargetPose
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_INFO,
    CAMERA_POSE,
    FORMATION,
    MAP_CHANGES,
    QUALITY,
    SIM_STATE,
    TARGET_POSE,
)
from services.camera.sources.simulated import SimulatedSettings, SimulatedSource
from services.kernels.rigid import look_at, planar
from services.mapper.voxel_map import VoxelMap
from services.recorder.log_writer import LogWriter
from services.runtime.tap import Sample
from services.world.deformation import parse_deformations

DT_NS, SPEED_M_S, VOXEL_M, NUM_CAMERAS = 100_000_000, 0.5, 0.02, 2
OPTICS = Intrinsics.from_vertical_fov(160, 120, 0.8)
SCENE = SceneSpec(
    object="torus",
    height_m=0.3,
    subdivide=0,
    deformations=parse_deformations("breathing"),
    seed=0,
)
AT_REST = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
_SCORE = Score(
    tolerance_m=0.02,
    coverage=0.5,
    coverage_observable=0.6,
    coverage_visible=0.9,
    precision=1.0,
    f_score=0.66,
    ghost_rate=0.0,
)


class SmallRecording:
    """What was recorded, and the file."""

    def __init__(self, path: Path, num_ticks: int) -> None:
        self.path = path
        self.messages: list[tuple[str, object]] = []
        """Keys and messages in order."""
        self.occupied: list[int] = []
        """Occupied voxels at each tick."""
        self._writer = LogWriter(path, {})
        self._sources = [
            SimulatedSource(
                SimulatedSettings(
                    camera=camera, seed=0, intrinsics=OPTICS, color=camera == 0, noise="nguyen"
                )
            )
            for camera in range(NUM_CAMERAS)
        ]
        self._map = VoxelMap(VOXEL_M, (-0.4, -0.4, -0.1), (0.4, 0.4, 0.5))
        for tick in range(num_ticks):
            self._tick(tick)
            self._writer.flush()
        self._writer.close({})

    def _tick(self, tick):
        t_ns = tick * DT_NS
        T_world_target = planar(SPEED_M_S * t_ns * 1e-9, 0.0, 0.3)
        stamp = {"t_ns": t_ns, "tick": tick, "frame_id": WORLD}
        target = Pose.from_matrix(T_world_target)
        centre = T_world_target[:3, 3] + (0, 0, 0.15)
        eyes = [centre + arm for arm in ((0.9, -0.5, 0.4), (-0.9, -0.5, 0.5))]
        poses = [Pose.from_matrix(look_at(eye, centre)) for eye in eyes]
        bodies = tuple(
            CameraBody(camera=i, pose=pose, twist=AT_REST) for i, pose in enumerate(poses)
        )
        state = SimState(
            **stamp,
            dt_ns=DT_NS,
            mode="lockstep",
            target=target,
            twist=AT_REST,
            scene=SCENE,
            cameras=bodies,
        )
        self._say(SIM_STATE.key, state)
        self._say(TARGET_POSE.key, TargetPose(**stamp, pose=target, twist=AT_REST))
        formation = Formation(
            **stamp,
            strategy="circle",
            centre=tuple(centre),
            radius_m=1.0,
            references=(),
            polygon=tuple(tuple(eye) for eye in eyes),
        )
        self._say(FORMATION.key, formation)
        self._map.clear()
        for camera, pose in enumerate(poses):
            self._see(camera, pose, state, stamp, T_world_target)
        rows = self._map.changes()
        self.occupied.append(self._map.counts().occupied)
        box = self._map.box
        changes = MapChanges.of(
            rows,
            **stamp | {"frame_id": "target"},
            rev=tick + 1,
            base_rev=tick,
            resolution_m=VOXEL_M,
            origin=tuple(box.origin_m),
            shape_voxels=box.shape,
            pose=target,
        )
        self._say(MAP_CHANGES.key, changes)
        self._say(QUALITY.key, _quality(stamp, tick + 1))

    def _see(self, camera, pose, state, stamp, T_world_target):
        frame = self._sources[camera].capture(state, color=camera == 0)
        cloud = DepthCloud.of(
            frame.depth,
            **stamp,
            camera=camera,
            pose=pose,
            max_range_m=5.0,
            t_capture_ns=stamp["t_ns"],
            intrinsics=OPTICS,
            depth_scale_m=0.001,
        )
        optical = stamp | {"frame_id": f"cam_{camera}_optical"}
        if frame.jpeg is not None:
            picture = ColorImage.of(
                np.asarray(frame.jpeg), **optical, camera=camera, width=160, height=120
            )
            self._say(CAMERA_COLOR.key_for(camera), picture)
        info = CameraInfo(
            **optical,
            camera=camera,
            intrinsics=OPTICS,
            depth_scale_m=0.001,
            min_range_m=0.1,
            max_range_m=5.0,
            noise="nguyen",
        )
        self._say(CAMERA_INFO.key_for(camera), info)
        self._say(CAMERA_CLOUD.key_for(camera), cloud)
        self._say(
            CAMERA_POSE.key_for(camera),
            CameraPose(**stamp, camera=camera, pose=pose, twist=AT_REST),
        )
        T_target_camera = np.linalg.inv(T_world_target) @ pose.matrix()
        pinhole = (OPTICS.fx, OPTICS.fy, OPTICS.cx, OPTICS.cy)
        self._map.fuse_depth(frame.depth, pinhole, T_target_camera)

    def _say(self, key, message):
        seq = len(self.messages)
        self.messages.append((key, message))
        envelope = Envelope(seq=seq, src="test", boot="b", t_pub_ns=1_000 + seq)
        self._writer.write(Sample(key, encode(message, envelope).join(), 2_000 + seq, None))

    def of(self, kind):
        """Return the messages of a kind, in order."""
        return [message for _, message in self.messages if isinstance(message, kind)]


def _quality(stamp, rev):
    return Quality(
        **stamp,
        rev=rev,
        stamp_true=(_SCORE, _SCORE),
        latency_true=(_SCORE, _SCORE),
        lag_ticks=0,
        missing=Missing(out_of_view=0.5, self_occluded=0, grazing=0, not_yet_updated=0),
        accuracy_m=0.01,
        completeness_m=0.01,
        chamfer_m=0.01,
        num_samples=10,
        num_voxels=10,
    )
