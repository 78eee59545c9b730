"""The newest of every message, and when it came."""

from dataclasses import dataclass, field

from schemas.camera import CameraInfo, CameraPose, ColorImage
from schemas.cloud import Cloud
from schemas.formation import Formation
from schemas.map import MapSummary
from schemas.sim import SimClock
from schemas.target import TargetEstimate, TargetPose


@dataclass
class Newest:
    """One of each, or one per camera: memory is bounded by what there is, not by time."""

    infos: dict[int, CameraInfo] = field(default_factory=dict)
    poses: dict[int, CameraPose] = field(default_factory=dict)
    clouds: dict[int, Cloud] = field(default_factory=dict)
    pictures: dict[int, ColorImage] = field(default_factory=dict)
    formation: Formation | None = None
    target: TargetPose | TargetEstimate | None = None
    clock: SimClock | None = None
    summary: MapSummary | None = None
    heard_s: dict[str, float] = field(default_factory=dict)
    """By topic key (`cams/{camera}/pose`): monotonic time of the last message."""

    def forget_camera(self, camera: int) -> None:
        """A camera has gone: nothing of it is drawn any more."""
        for held in (self.infos, self.poses, self.clouds, self.pictures):
            held.pop(camera, None)
