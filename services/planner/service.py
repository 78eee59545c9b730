"""The planner on the bus: target/pose in, cams/<i>/goal and formation out."""

import logging
from typing import Any

import numpy as np

from schemas.camera import CameraGoal
from schemas.formation import Formation, Reference
from schemas.geometry import WORLD, Pose, Twist
from schemas.target import TargetPose
from schemas.topics import CAMERA_GOAL, FORMATION, TARGET_POSE
from services.planner.formation import FormationSettings
from services.planner.motion import Motion
from services.planner.plan import Plan
from services.planner.settings import PlannerSettings
from services.planner.strategies.open import open_strategy
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.loop import Loop
from services.runtime.reader import Received

logger = logging.getLogger(__name__)


class PlannerService:
    """Answers each pose of the target with a reference for every camera."""

    def __init__(self, settings: PlannerSettings, bus: Bus, loop: Loop) -> None:
        self._bus = bus
        self._loop = loop
        self._dt_s = settings.dt_s
        self._adopt(settings.formation())
        loop.on(TARGET_POSE, self._on_target)
        loop.serve("get", self._get)
        loop.serve("set", self._set)

    def _adopt(self, formation: FormationSettings) -> None:
        # Opened first: a strategy that cannot be had must leave the old one in place.
        self._strategy = open_strategy(formation.strategy_settings())
        self._formation = formation

    def _on_target(self, received: Received[TargetPose]) -> None:
        pose = received.message
        if pose.frame_id != WORLD:
            self._bus.refuse(received.key, f"frame_id is {pose.frame_id!r}; it must be {WORLD!r}")
            return
        with self._loop.stage("plan"):
            target = _motion(pose).predicted(self._dt_s)
            plan = self._strategy.plan(target, pose.t_ns * 1e-9 + self._dt_s)
        with self._loop.stage("publish"):
            message = _formation(pose, plan, self._formation.strategy)
            for view in message.references:
                goal = CameraGoal(
                    t_ns=pose.t_ns,
                    tick=pose.tick,
                    frame_id=pose.frame_id,
                    camera=view.camera,
                    pose=view.pose,
                    twist=view.twist,
                )
                self._bus.publish(CAMERA_GOAL, goal, camera=view.camera)
            self._bus.publish(FORMATION, message)

    def _get(self, params: dict[str, Any]) -> dict[str, Any]:
        only(params)
        return self._formation.model_dump(mode="json")

    def _set(self, params: dict[str, Any]) -> dict[str, Any]:
        self._adopt(self._formation.changed(params))
        logger.info("set %s", params)
        return self._formation.model_dump(mode="json")


def _motion(pose: TargetPose) -> Motion:
    linear, angular = np.asarray(pose.twist.linear), np.asarray(pose.twist.angular)
    return Motion(pose.pose.matrix(), linear, angular)


def _formation(pose: TargetPose, plan: Plan, strategy: str) -> Formation:
    return Formation(
        t_ns=pose.t_ns,
        tick=pose.tick,
        frame_id=pose.frame_id,
        strategy=strategy,
        centre=tuple(plan.centre_m.tolist()),
        radius_m=plan.radius_m,
        references=tuple(
            Reference(
                camera=index,
                pose=Pose.from_matrix(view.T),
                twist=Twist(
                    linear=tuple(view.linear.tolist()), angular=tuple(view.angular.tolist())
                ),
            )
            for index, view in enumerate(plan.views)
        ),
        polygon=tuple(tuple(corner.tolist()) for corner in plan.polygon_m),
    )
