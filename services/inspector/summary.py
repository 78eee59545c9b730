"""One line about any message."""

import math
from typing import Any

import numpy as np
from pydantic import BaseModel

from schemas.camera import CameraCommand, CameraGoal, CameraInfo, CameraPose, CloudHeard
from schemas.formation import Formation
from schemas.geometry import Pose, Twist
from schemas.map import MapSummary
from schemas.message import ArrayMessage, Message
from schemas.metrics import Quality
from schemas.sim import SimClock, SimState
from schemas.status import ServiceStatus
from schemas.target import TargetEstimate, TargetObservation, TargetPose
from services.inspector.arrays import array_words, size

MAX_WORDS = 8
"""Fields that a line tells of a message that is not one of those known here."""


def one_line(message: Message) -> str:
    """Say in one line what a message says; its array is described and not shown."""
    return f"tick {message.tick}  {_words(message)}"


def _words(message: Message) -> str:
    match message:
        case TargetPose():
            return f"{_body(message.pose)}  {_motion(message.twist)}"
        case TargetEstimate():
            return (
                f"{_body(message.pose)}  sigma {message.sigma_m:.3g} m  {_motion(message.twist)}  "
                f"refused {message.num_refused}  missed {message.num_missed}"
            )
        case TargetObservation():
            seen = message.sighting
            return "nothing seen" if seen is None else f"{_body(seen.pose)}  sigma {seen.sigma_m}"
        case CameraPose() | CameraGoal():
            return f"{_view(message.pose)}  {_motion(message.twist)}"
        case CloudHeard():
            return "the mapper has the cloud of this tick"
        case CameraCommand():
            return _motion(message.twist)
        case CameraInfo():
            optics = message.intrinsics
            return (
                f"{optics.width} x {optics.height} px  f {optics.fx:.1f} px  range "
                f"{message.min_range_m:g} to {message.max_range_m:g} m  noise {message.noise}"
            )
        case ArrayMessage():
            return array_words(message)
        case Formation():
            return _formation(message)
        case MapSummary():
            return _map(message)
        case Quality():
            score = message.stamp_true[1]
            return (
                f"coverage {score.coverage:.1%}  of visible {score.coverage_visible:.1%}  "
                f"precision {score.precision:.1%}  F-score {score.f_score:.1%}"
            )
        case ServiceStatus():
            return _status(message)
        case SimClock():
            waits = f"  waits for {', '.join(message.waiting_for)}" if message.waiting_for else ""
            return f"{message.state}  {message.mode}  dt {message.dt_ns / 1e6:.4g} ms{waits}"
        case SimState():
            return (
                f"{message.scene.object} {_body(message.target)}  {_motion(message.twist)}  "
                f"{len(message.cameras)} cameras"
            )
        case _:
            return _fields(message)


def _formation(message: Formation) -> str:
    words = f"{message.strategy}  {len(message.references)} cameras  radius {message.radius_m:g} m"
    if message.feasibility is None:
        return words
    broken = [rule.inequality for rule in message.feasibility.rules if not rule.holds]
    return f"{words}  {'infeasible: ' + ', '.join(broken) if broken else 'feasible'}"


def _map(message: MapSummary) -> str:
    missing = ", ".join(str(camera) for camera in message.cameras_missing)
    return (
        f"rev {message.rev}  {len(message.cameras_used)} cameras"
        f"{f' (missing {missing})' if missing else ''}  occupied {message.num_occupied}  "
        f"changed {message.num_changed}  fuse {message.fuse_ms:.1f} ms  "
        f"latency {message.latency_ms:.0f} ms"
    )


def _status(message: ServiceStatus) -> str:
    rates = [
        f"{topic.key} {topic.rate_hz:.1f} Hz" for topic in message.topics if topic.sent
    ]  # What it sends is what it is there for.
    return (
        f"{message.service}/{message.instance}  up {message.uptime_s:.0f} s  cpu "
        f"{message.cpu_s:.1f} s  {size(message.rss_bytes)}  bad {message.bad_messages}  sends "
        f"{', '.join(rates) or 'nothing'}"
    )


def _body(pose: Pose) -> str:
    R = pose.matrix()[:3, :3]
    return f"{_at(pose)}  heading {math.degrees(math.atan2(R[1, 0], R[0, 0])):.1f} deg"


def _view(pose: Pose) -> str:
    axis = pose.matrix()[:3, 2]  # The optical axis is z.
    up = math.degrees(math.asin(max(-1.0, min(1.0, float(axis[2])))))
    return (
        f"{_at(pose)}  looks to {math.degrees(math.atan2(axis[1], axis[0])):.1f} deg, up {up:.1f}"
    )


def _at(pose: Pose) -> str:
    return "at {:.3f} {:.3f} {:.3f} m".format(*pose.position)


def _motion(twist: Twist) -> str:
    speed, turn = (float(np.linalg.norm(part)) for part in (twist.linear, twist.angular))
    return f"moves {speed:.3f} m/s, turns {math.degrees(turn):.1f} deg/s"


def _fields(message: Message) -> str:
    own = [name for name in type(message).model_fields if name not in Message.model_fields]
    return "  ".join(f"{name} {_value(getattr(message, name))}" for name in own[:MAX_WORDS])


def _value(value: Any) -> str:
    if isinstance(value, BaseModel):
        return "{" + ", ".join(type(value).model_fields) + "}"
    if isinstance(value, (tuple, list, dict)):
        return f"{len(value)} of them"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
