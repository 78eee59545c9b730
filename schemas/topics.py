"""THE table: every key of the bus, its message, its rate and how it is delivered."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter

from schemas.camera import (
    MAX_CAMERAS,
    CameraCommand,
    CameraGoal,
    CameraInfo,
    CameraPose,
    CloudHeard,
    ColorImage,
)
from schemas.cloud import CLOUD, Cloud
from schemas.formation import Formation
from schemas.map import MapChanges, MapFull, MapSummary
from schemas.message import Message
from schemas.metrics import Quality
from schemas.sim import SimClock, SimState
from schemas.status import ServiceStatus
from schemas.target import TargetEstimate, TargetObservation, TargetPose

M = TypeVar("M", bound=Message, covariant=True)

MAX_KEY_LENGTH = 128
_INDICES = frozenset(str(camera) for camera in range(MAX_CAMERAS))

RATE_HZ = 15.0
"""Instants per second that everybody declares; lockstep and `--dt` may run otherwise."""


class Delivery(Enum):
    """What happens to a message whose receiver is slower than its sender."""

    LATEST_WINS = "latest wins"
    """The newest replaces the older; loss is counted."""
    LATCHED = "latched"
    """Latest wins, and repeated at the declared rate for those who come late."""
    NEVER_DROP = "never drop"
    """Queued in order; a full queue loses the oldest, which its numbering then shows."""
    QUERY = "query"
    """Sent on request only."""


@dataclass(frozen=True)
class Topic(Generic[M]):
    """One row: `{camera}` in the key is a camera's index, `{service}` a `service[/instance]`."""

    key: str
    message: Any
    rate_hz: float
    """0: no rate is promised."""
    delivery: Delivery
    sender: str
    shared_memory: bool = False
    truth: bool = False
    """What is really so: planner and mapper must do without it."""

    @cached_property
    def adapter(self) -> TypeAdapter[Any]:
        """Validates what arrives on this key."""
        return TypeAdapter(self.message)

    def key_for(self, camera: int | None = None, service: str | None = None) -> str:
        """Return the concrete key.

        Raises:
            ValueError: If the index is missing, superfluous or out of range.
        """
        if ("{camera}" in self.key) != (camera is not None):
            raise ValueError(f"{self.key}: camera is {camera}; give an index iff the key has one")
        if camera is not None and not 0 <= camera < MAX_CAMERAS:
            raise ValueError(f"{self.key}: camera {camera} must be 0..{MAX_CAMERAS - 1}")
        if ("{service}" in self.key) != (service is not None):
            raise ValueError(f"{self.key}: service is {service}; give a name iff the key has one")
        return self.key.format(camera=camera, service=service)

    def expression(self, camera: int | None = None) -> str:
        """Return the key expression of one camera, or of all."""
        return self.key.format(camera="*" if camera is None else camera, service="**")


_LATEST, _LATCHED = Delivery.LATEST_WINS, Delivery.LATCHED

TARGET_POSE = Topic[TargetPose]("target/pose", TargetPose, RATE_HZ, _LATEST, "simulator")
TARGET_OBSERVATION = Topic[TargetObservation](
    "target/observation", TargetObservation, RATE_HZ, _LATEST, "simulator"
)
TARGET_ESTIMATE = Topic[TargetEstimate](
    "target/estimate", TargetEstimate, RATE_HZ, _LATEST, "planner"
)
CAMERA_GOAL = Topic[CameraGoal]("cams/{camera}/goal", CameraGoal, RATE_HZ, _LATEST, "planner")
CAMERA_POSE = Topic[CameraPose]("cams/{camera}/pose", CameraPose, RATE_HZ, _LATEST, "camera")
CAMERA_COMMAND = Topic[CameraCommand](
    "cams/{camera}/cmd", CameraCommand, RATE_HZ, _LATEST, "camera"
)
CAMERA_INFO = Topic[CameraInfo]("cams/{camera}/info", CameraInfo, 1.0, _LATCHED, "camera")
CAMERA_CLOUD = Topic[Cloud]("cams/{camera}/cloud", CLOUD, RATE_HZ, _LATEST, "camera", True)
CAMERA_COLOR = Topic[ColorImage]("cams/{camera}/color", ColorImage, 0, _LATEST, "camera", True)
CLOUD_HEARD = Topic[CloudHeard]("cams/{camera}/heard", CloudHeard, 0, _LATEST, "mapper")
FORMATION = Topic[Formation]("formation", Formation, RATE_HZ, _LATEST, "planner")
MAP_CHANGES = Topic[MapChanges](
    "map/changes", MapChanges, RATE_HZ, Delivery.NEVER_DROP, "mapper", True
)
MAP_FULL = Topic[MapFull]("map/full", MapFull, 0, Delivery.QUERY, "mapper")
MAP_SUMMARY = Topic[MapSummary]("map/summary", MapSummary, RATE_HZ, _LATEST, "mapper")
SERVICE_STATUS = Topic[ServiceStatus]("metrics/{service}", ServiceStatus, 1.0, _LATEST, "all")
QUALITY = Topic[Quality]("metrics/quality", Quality, RATE_HZ, _LATEST, "evaluator")
SIM_CLOCK = Topic[SimClock]("sim/clock", SimClock, RATE_HZ, _LATEST, "simulator")
SIM_STATE = Topic[SimState]("sim/state", SimState, RATE_HZ, _LATEST, "simulator", truth=True)

TOPICS: tuple[Topic[Message], ...] = (
    TARGET_POSE,
    TARGET_OBSERVATION,
    TARGET_ESTIMATE,
    CAMERA_GOAL,
    CAMERA_POSE,
    CAMERA_COMMAND,
    CAMERA_INFO,
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CLOUD_HEARD,
    FORMATION,
    MAP_CHANGES,
    MAP_FULL,
    MAP_SUMMARY,
    QUALITY,  # Before SERVICE_STATUS, whose expression would match it.
    SERVICE_STATUS,
    SIM_CLOCK,
    SIM_STATE,
)


def find(key: str) -> Topic[Message] | None:
    """Return the row that a concrete key belongs to."""
    if len(key) > MAX_KEY_LENGTH:
        return None
    parts = key.split("/")
    for topic in TOPICS:
        pattern = topic.key.split("/")
        if pattern[-1] == "{service}":
            if parts[0] == pattern[0] and 2 <= len(parts) <= 3:
                return topic
        elif len(parts) == len(pattern) and all(
            want == have or (want == "{camera}" and have in _INDICES)
            for want, have in zip(pattern, parts, strict=True)
        ):
            return topic
    return None


def camera_of(key: str) -> int | None:
    """Return the camera index in a concrete key, if it has one."""
    parts = key.split("/")
    return int(parts[1]) if parts[0] == "cams" and parts[1] in _INDICES else None
