"""A camera on the bus: sim/state and its goal in; cloud, pose, command, info, colour out."""

import time

import numpy as np

from schemas.camera import CameraCommand, CameraGoal, CameraInfo, CameraPose, ColorImage
from schemas.cloud import DepthCloud
from schemas.sim import CameraBody, SimState
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_COMMAND,
    CAMERA_GOAL,
    CAMERA_INFO,
    CAMERA_POSE,
    SIM_STATE,
)
from services.camera.pilot import command
from services.camera.settings import CameraSettings
from services.camera.sources.open import open_source
from services.camera.sources.simulated import body_of
from services.camera.sources.source import Frame
from services.camera.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.reader import Received

INFO_PERIOD_S = 1 / CAMERA_INFO.rate_hz


class CameraService:
    """Looks at each instant and asks its robot to go where the planner wants it.

    States that come while it renders are passed over but for the newest: that is the inbox's law.
    """

    def __init__(self, settings: CameraSettings, bus: Bus, loop: Loop) -> None:
        warm_up()  # Before others wait for us: the first view must not be late.
        self._settings, self._bus, self._loop = settings, bus, loop
        self._camera = settings.camera
        self._intrinsics = settings.intrinsics()
        self._source = open_source(settings.source_settings())
        self._state: SimState | None = None
        self._goal: CameraGoal | None = None
        self._cloud: DepthCloud | None = None
        self._command: CameraCommand | None = None
        """The acknowledgement of the state at hand."""
        loop.on(SIM_STATE, self._on_state)
        loop.on(CAMERA_GOAL, self._on_goal, self._camera)
        loop.after(0.0, self._introduce)
        loop.every(INFO_PERIOD_S, self._introduce)

    def _on_state(self, received: Received[SimState]) -> None:
        state = received.message
        body = body_of(state, self._camera)
        if body is None:
            return  # Not placed yet: the planner has not said where.
        if state == self._state:
            self._repeat()
            return
        t_capture_ns = time.time_ns()
        color = self._settings.color and self._bus.matching(CAMERA_COLOR, self._camera)
        with self._loop.stage("render"):
            frame = self._source.capture(state, color=color)
        with self._loop.stage("publish"):
            self._publish(state, body, frame, t_capture_ns)
        self._state, self._command = state, None
        self._drive()

    def _on_goal(self, received: Received[CameraGoal]) -> None:
        self._goal = received.message
        self._drive()

    def _drive(self) -> None:
        """Command once per state: in lockstep with that tick's goal, else with the newest."""
        state, goal = self._state, self._goal
        if self._command is not None or state is None or goal is None:
            return
        if state.mode == "lockstep" and goal.tick != state.tick:
            return
        body = body_of(state, self._camera)
        assert body is not None
        twist = command(body, state.tick, goal, state.dt_ns * 1e-9, self._settings.drive)
        self._command = CameraCommand(
            t_ns=state.t_ns,
            tick=state.tick,
            frame_id=state.frame_id,
            camera=self._camera,
            twist=twist,
        )
        self._bus.publish(CAMERA_COMMAND, self._command, camera=self._camera)

    def _repeat(self) -> None:
        """Say again what was said of this state: it is told twice when an answer was lost."""
        if self._cloud is not None:
            self._bus.publish(CAMERA_CLOUD, self._cloud, camera=self._camera)
        if self._command is not None:
            self._bus.publish(CAMERA_COMMAND, self._command, camera=self._camera)

    def _publish(self, state: SimState, body: CameraBody, frame: Frame, t_capture_ns: int) -> None:
        stamp = {"t_ns": state.t_ns, "tick": state.tick, "camera": self._camera}
        self._cloud = DepthCloud.of(
            frame.depth,
            **stamp,
            frame_id=state.frame_id,
            pose=body.pose,
            max_range_m=self._settings.max_range_m,
            t_capture_ns=t_capture_ns,
            intrinsics=self._intrinsics,
            depth_scale_m=self._settings.depth_scale_m,
        )
        self._bus.publish(CAMERA_CLOUD, self._cloud, camera=self._camera)
        pose = CameraPose(**stamp, frame_id=state.frame_id, pose=body.pose, twist=body.twist)
        self._bus.publish(CAMERA_POSE, pose, camera=self._camera)
        if frame.jpeg is not None:
            picture = ColorImage.of(
                np.asarray(frame.jpeg),
                **stamp,
                frame_id=self._optical_frame,
                width=self._intrinsics.width,
                height=self._intrinsics.height,
            )
            self._bus.publish(CAMERA_COLOR, picture, camera=self._camera)

    def _introduce(self) -> None:
        state, settings = self._state, self._settings
        info = CameraInfo(
            t_ns=0 if state is None else state.t_ns,
            tick=0 if state is None else state.tick,
            frame_id=self._optical_frame,
            camera=self._camera,
            intrinsics=self._intrinsics,
            depth_scale_m=settings.depth_scale_m,
            min_range_m=settings.min_range_m,
            max_range_m=settings.max_range_m,
            baseline_m=settings.baseline_m if settings.noise == "d4xx" else None,
            noise=settings.noise,
        )
        self._bus.publish(CAMERA_INFO, info, camera=self._camera)

    @property
    def _optical_frame(self) -> str:
        return f"cam_{self._camera}_optical"
