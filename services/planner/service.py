"""The planner on the bus: where the target is in, cams/<i>/goal and formation out."""

import logging
from collections.abc import Sequence
from typing import Any

from schemas.camera import MAX_CAMERAS, CameraGoal, CameraPose
from schemas.feasibility import Feasibility
from schemas.formation import Formation, Reference
from schemas.geometry import WORLD
from schemas.message import Message
from schemas.topics import CAMERA_GOAL, CAMERA_POSE, FORMATION
from services.kernels.rigid import apply
from services.planner.director import Director, Orders
from services.planner.gate import Gate
from services.planner.goals import camera_goal
from services.planner.live_feasibility import report_on
from services.planner.motion import Motion
from services.planner.remount import Remount
from services.planner.settings import PlannerSettings
from services.planner.target_service import open_target
from services.planner.wheels import Carrier, Mounted, open_carrier
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.loop import Loop
from services.runtime.reader import Received

logger = logging.getLogger(__name__)


class PlannerService:
    """Answers each instant with a reference for every camera."""

    def __init__(self, settings: PlannerSettings, bus: Bus, loop: Loop) -> None:
        self._bus = bus
        self._loop = loop
        self._dt_s = settings.dt_s
        self._gate = Gate(
            settings.limits, settings.known_motion(), estimated=settings.target != "given"
        )
        self._gate.admit(settings.formation())
        self._director = Director(settings.formation(), self._gate.foreknowledge)
        self._working: list[int] = []
        self._carrier: Carrier = open_carrier(self._director.formation.drive)
        loop.on(CAMERA_POSE, self._on_pose)
        loop.on_alive("camera", self._on_camera)
        self._target = open_target(settings, bus, loop, self._aim)
        loop.serve("get", self._get)
        loop.serve("set", self._set)

    def _on_camera(self, instance: str, alive: bool) -> None:
        if not instance.isdecimal() or int(instance) >= MAX_CAMERAS:
            return
        if alive:
            self._director.appear(int(instance))
        else:
            self._director.vanish(int(instance))

    def _on_pose(self, received: Received[CameraPose]) -> None:
        told = received.message
        if told.frame_id != WORLD:
            self._bus.refuse(received.key, f"frame_id is {told.frame_id!r}; it must be {WORLD!r}")
            return
        self._director.saw(told.camera, told.pose.matrix())

    def _aim(self, stamp: Message, target: Motion) -> None:
        with self._loop.stage("plan"):
            t_s = stamp.t_ns * 1e-9 + self._dt_s
            self._gate.saw(target, t_s)
            orders = self._director.plan(target, t_s)
            self._gate.mounted(orders.psi_rad)
            self._tell(orders)
            mounted = self._carrier.carry(orders.cameras, orders.views, target, t_s, orders.psi_rad)
        with self._loop.stage("check"):
            feasibility = self._check(orders, mounted, target)
        with self._loop.stage("publish"):
            goals = [
                camera_goal(stamp, *each) for each in zip(orders.cameras, mounted, strict=True)
            ]
            for goal in goals:
                self._bus.publish(CAMERA_GOAL, goal, camera=goal.camera)
            self._bus.publish(FORMATION, _formation(stamp, orders, goals, feasibility))

    def _check(
        self, orders: Orders, mounted: Sequence[Mounted], target: Motion
    ) -> Feasibility | None:
        told = mounted[: orders.num_working]
        if not told:
            return None
        formation = self._director.formation
        centre_m = apply(target.T, [0.0, 0.0, formation.centre_height_m])
        return report_on(told, target, centre_m, self._gate.limits(formation))

    def _tell(self, orders: Orders) -> None:
        working = sorted(orders.cameras[: orders.num_working])
        if working != self._working:
            self._working = working
            logger.info("formation of %d: cameras %s", len(working), ", ".join(map(str, working)))

    def _get(self, params: dict[str, Any]) -> dict[str, Any]:
        only(params)
        return self._director.formation.model_dump(mode="json")

    def _set(self, params: dict[str, Any]) -> dict[str, Any]:
        before = self._director.formation
        wanted = before.changed(params)
        if not wanted.goes_like(before):
            self._gate.admit(wanted, params)
        self._director.change(wanted)
        if self._director.formation.drive != before.drive:
            self._carrier = Remount(self._carrier, open_carrier(self._director.formation.drive))
        logger.info("set %s", params)
        return self._director.formation.model_dump(mode="json")


def _formation(
    stamp: Message,
    orders: Orders,
    goals: Sequence[CameraGoal],
    feasibility: Feasibility | None,
) -> Formation:
    working = goals[: orders.num_working]
    return Formation(
        t_ns=stamp.t_ns,
        tick=stamp.tick,
        frame_id=WORLD,
        strategy=orders.strategy,
        centre=tuple(orders.plan.centre_m.tolist()),
        radius_m=orders.plan.radius_m,
        references=tuple(
            Reference(camera=goal.camera, pose=goal.pose, twist=goal.twist) for goal in working
        ),
        polygon=tuple(goal.pose.position for goal in working) if orders.plan.polygon_m else (),
        feasibility=feasibility,
    )
