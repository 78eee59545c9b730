"""How robots with wheels carry the cameras of any formation that moves with its target.

Each camera is fixed on its robot so that it sees the target centrally while all drive straight
ahead, parallel to the target. A robot then heads where its view moves, and the camera looks where
the robot takes it. Source: Lopez-Nicolas, Aranda, Mezouar, T-RO 36(1), 2020, sect. II-III.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, assert_never

import numpy as np

from services.kernels.rigid import FloatArray, optical_yaw, rotation_exp
from services.planner.motion import Motion

DriveName = Literal["flying", "unicycle"]

SLOWEST_MPS = 0.02
"""A view that moves slower has no direction that could be told from noise: its robot waits."""
_SMOOTHING_S = 0.1
"""Time constant of the rates, which are differences of what may be estimates."""
_OTHER_WAY_RAD = np.pi / 2 + 0.1
"""A robot drives the other way round when its camera would look off by more than this."""
_HARDEST_MPS2 = 0.3
"""No stronger acceleration is told: estimates of a target that has only been seen have steps."""
_GAP_S = 1.0
"""After a longer silence differences tell nothing."""
_RESET_S = 0.25
"""Time that goes back farther was reset; less is a message that was overtaken: as the director."""


@dataclass(frozen=True)
class Robot:
    """How a robot shall drive, world frame; it is below its camera."""

    heading_rad: float
    """phi_r, (-pi, pi]; no angle on the circle."""
    v_mps: float
    """Negative in reverse."""
    omega_rps: float
    v_dot: float
    camera_yaw_rad: float
    """psi: from the heading to where the camera looks."""


class Mounted(NamedTuple):
    """A camera's view, and the robot that carries it; None: it flies."""

    view: Motion
    robot: Robot | None


class Carrier(Protocol):
    """What carries the cameras."""

    def carry(
        self,
        cameras: Sequence[int],
        views: Sequence[Motion],
        target: Motion,
        t_s: float,
        psi_rad: FloatArray | None = None,
    ) -> tuple[Mounted, ...]:
        """Return what each camera is told.

        Args:
            cameras: whose view each is.
            views: world frame, looking at the target.
            target: how it moves.
            t_s: the instant.
            psi_rad: (N,) how the first N cameras are fixed on robots that are built now, from the
                heading; as their views look if not given.
        """
        ...


class Wings:
    """Cameras that fly take any view."""

    def carry(
        self,
        cameras: Sequence[int],  # noqa: ARG002
        views: Sequence[Motion],
        target: Motion,  # noqa: ARG002
        t_s: float,  # noqa: ARG002
        psi_rad: FloatArray | None = None,  # noqa: ARG002
    ) -> tuple[Mounted, ...]:
        """Return the views as they are."""
        return tuple(Mounted(view, None) for view in views)


@dataclass(frozen=True)
class _Past:
    """A robot at the instant before."""

    robot: Robot
    t_s: float
    sense: float
    """1 or -1: forwards, in reverse."""


class Wheels:
    """Remembers how each camera was mounted and what its robot did."""

    def __init__(self) -> None:
        self._past: dict[int, _Past] = {}

    def carry(
        self,
        cameras: Sequence[int],
        views: Sequence[Motion],
        target: Motion,
        t_s: float,
        psi_rad: FloatArray | None = None,
    ) -> tuple[Mounted, ...]:
        """Return robots that go where the views go; see `Carrier`."""
        if any(past.t_s - _RESET_S > t_s for past in self._past.values()):
            self._past.clear()  # The world was reset, and its robots are built anew.
        psi = [] if psi_rad is None else psi_rad.tolist()
        psi += [None] * (len(cameras) - len(psi))
        return tuple(
            self._mounted(camera, view, target, t_s, mount)
            for camera, view, mount in zip(cameras, views, psi, strict=True)
        )

    def _mounted(
        self, camera: int, view: Motion, target: Motion, t_s: float, psi_rad: float | None
    ) -> Mounted:
        gaze_rad = optical_yaw(view.T)
        past = self._past.get(camera)
        if past is None:
            past = _built(gaze_rad, target, t_s, psi_rad)
        robot, sense = _driven(past, view, gaze_rad, t_s)
        self._past[camera] = _Past(robot, max(past.t_s, t_s), sense)
        return Mounted(_fixed(view, robot, gaze_rad), robot)


def open_carrier(drive: DriveName) -> Carrier:
    """Build what carries the cameras."""
    match drive:
        case "flying":
            return Wings()
        case "unicycle":
            return Wheels()
        case _:
            assert_never(drive)


def _built(gaze_rad: float, target: Motion, t_s: float, psi_rad: float | None) -> _Past:
    """Return a robot that stands parallel to the target, its camera looking at it or as told."""
    phi_rad = float(np.arctan2(target.T[1, 0], target.T[0, 0]))
    omega_rps = float(target.angular[2])
    mount_rad = wrapped(gaze_rad - phi_rad if psi_rad is None else psi_rad)
    robot = Robot(phi_rad, 0.0, omega_rps, 0.0, mount_rad)
    return _Past(robot, t_s, sense=1.0)


def _driven(past: _Past, view: Motion, gaze_rad: float, t_s: float) -> tuple[Robot, float]:
    """Return what the robot does now, and its sense."""
    before = past.robot
    speed_mps = float(np.hypot(view.linear[0], view.linear[1]))
    if speed_mps < SLOWEST_MPS:
        return Robot(before.heading_rad, 0.0, 0.0, 0.0, before.camera_yaw_rad), past.sense
    course_rad = float(np.arctan2(view.linear[1], view.linear[0]))
    sense = past.sense
    heading_rad = course_rad if sense > 0 else wrapped(course_rad + np.pi)
    if abs(wrapped(gaze_rad - heading_rad - before.camera_yaw_rad)) > _OTHER_WAY_RAD:
        sense, heading_rad = -sense, wrapped(heading_rad + np.pi)
    v_mps = sense * speed_mps
    passed_s = t_s - past.t_s
    omega_rps, v_dot = before.omega_rps, before.v_dot
    if before.v_mps != 0.0 and 0.0 < passed_s < _GAP_S:
        share = 1.0 - float(np.exp(-passed_s / _SMOOTHING_S))
        turned_rps = wrapped(heading_rad - before.heading_rad) / passed_s
        omega_rps += share * (turned_rps - omega_rps)
        v_dot += share * ((v_mps - before.v_mps) / passed_s - v_dot)
        v_dot = min(max(v_dot, -_HARDEST_MPS2), _HARDEST_MPS2)
    return Robot(heading_rad, v_mps, omega_rps, v_dot, before.camera_yaw_rad), sense


def _fixed(view: Motion, robot: Robot, gaze_rad: float) -> Motion:
    """Return the view turned to where its robot points it; place, height and tilt stay."""
    off_rad = robot.heading_rad + robot.camera_yaw_rad - gaze_rad
    T: FloatArray = view.T.copy()
    T[:3, :3] = rotation_exp([0.0, 0.0, off_rad]) @ T[:3, :3]
    return Motion(T, view.linear, np.array([0.0, 0.0, robot.omega_rps]))


def wrapped(angle_rad: float) -> float:
    """Return the same angle in (-pi, pi]."""
    return float(np.pi - np.mod(np.pi - angle_rad, 2 * np.pi))
