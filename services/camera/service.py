"""A camera on the bus: sim/state and its goal in; cloud, pose, command, info, colour out."""

import time
from typing import Any

import numpy as np

from schemas.camera import CameraCommand, CameraGoal, CameraInfo, CameraPose, CloudHeard, ColorImage
from schemas.cloud import DepthCloud
from schemas.sim import CameraBody, SimState
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_COMMAND,
    CAMERA_GOAL,
    CAMERA_INFO,
    CAMERA_POSE,
    CLOUD_HEARD,
    SIM_STATE,
)
from services.camera.settings import CameraSettings
from services.camera.sources.open import open_source
from services.camera.sources.simulated import body_of
from services.camera.sources.source import Frame
from services.camera.under_way import UnderWay
from services.camera.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.later import Later
from services.runtime.loop import Loop
from services.runtime.reader import Received
from services.world.scene import scene_of

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
        self._pilot = settings.pilot()
        self._source = open_source(settings.source_settings())
        self._state: SimState | None = None
        self._goal: CameraGoal | None = None
        self._cloud: DepthCloud | None = None
        self._command: CameraCommand | None = None
        """The acknowledgement of the state at hand."""
        self._under_way: UnderWay[DepthCloud] = UnderWay(settings.clouds_under_way)
        loop.on(SIM_STATE, self._on_state)
        loop.on(CAMERA_GOAL, self._on_goal, self._camera)
        loop.on(CLOUD_HEARD, self._on_heard, self._camera)
        loop.on_alive("mapper", lambda *_: self._send(self._under_way.forget(time.monotonic())))
        loop.serve_later("prepare", self._prepare)
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

    def _prepare(self, params: dict[str, Any]) -> Later[None]:
        """Load the scene that is about to come, beside the instants."""
        scene = scene_of(params)
        return Later(lambda: self._source.prepare(scene), lambda _: {"object": scene.object})

    def _on_goal(self, received: Received[CameraGoal]) -> None:
        if objection := self._pilot.objection(received.message):
            self._bus.refuse(received.key, objection)  # It stands still, and nobody waits for it.
        self._goal = received.message
        self._drive()

    def _on_heard(self, received: Received[CloudHeard]) -> None:
        self._send(self._under_way.heard(received.message.tick, time.monotonic()))

    def _drive(self) -> None:
        """Command once per state: in lockstep with that tick's goal, else with the newest."""
        state, goal = self._state, self._goal
        if self._command is not None or state is None or goal is None:
            return
        if state.mode == "lockstep" and goal.tick != state.tick:
            return
        body = body_of(state, self._camera)
        assert body is not None
        twist = self._pilot.command(body, state.tick, goal, state.dt_ns * 1e-9)
        self._command = CameraCommand(
            t_ns=state.t_ns,
            tick=state.tick,
            frame_id=state.frame_id,
            camera=self._camera,
            twist=twist,
            camera_yaw_rad=self._mounting(goal),
        )
        self._bus.publish(CAMERA_COMMAND, self._command, camera=self._camera)

    def _mounting(self, goal: CameraGoal) -> float | None:
        """Return how the camera is turned on its robot; None if it flies."""
        if self._settings.drive == "flying" or goal.robot is None:
            return None
        return goal.robot.camera_yaw_rad

    def _repeat(self) -> None:
        """Say again what was said of this state: it is told twice when an answer was lost."""
        self._send(self._cloud)
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
        if frame.jpeg is not None:  # Before the cloud: who fuses that wants its picture at hand.
            picture = ColorImage.of(
                np.asarray(frame.jpeg),
                **stamp,
                frame_id=self._optical_frame,
                width=self._intrinsics.width,
                height=self._intrinsics.height,
            )
            self._bus.publish(CAMERA_COLOR, picture, camera=self._camera)
        if state.mode == "lockstep":  # Every tick is waited for, however long it takes.
            self._under_way.drop()
            self._send(self._cloud)
        else:
            self._send(self._under_way.offer(state.tick, self._cloud, time.monotonic()))
            self._count_replaced()
        pose = CameraPose(**stamp, frame_id=state.frame_id, pose=body.pose, twist=body.twist)
        self._bus.publish(CAMERA_POSE, pose, camera=self._camera)

    def _send(self, cloud: DepthCloud | None) -> None:
        if cloud is not None:
            self._bus.publish(CAMERA_CLOUD, cloud, camera=self._camera)

    def _count_replaced(self) -> None:
        if num := self._under_way.num_replaced:
            key = CAMERA_CLOUD.key_for(self._camera)
            self._bus.meters.of(CAMERA_CLOUD, key, sent=True).lost = num

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
