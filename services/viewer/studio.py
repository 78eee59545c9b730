"""All that the viewer knows of a run, and the frames made of it."""

import time
from collections.abc import Mapping
from dataclasses import replace

from schemas.sim import SimState
from schemas.status import ServiceStatus
from schemas.target import TargetEstimate, TargetPose
from services.runtime.map_mirror import MapMirror
from services.viewer.newest import Newest
from services.viewer.options import Options
from services.viewer.plots import Plots
from services.viewer.primitives import Frame, Image, Points, Surface
from services.viewer.scene import frame
from services.viewer.trail import Trail
from services.viewer.truth import Truth
from services.viewer.voxels import Voxels
from services.world.errors import WorldError

_PAINT_PERIOD_S = 0.5
"""The comparison with the truth takes longer than all the rest of a frame."""


class Studio:
    """Fed by messages, asked for frames; holds what is newest, and bounded pieces of the past."""

    def __init__(self) -> None:
        self.newest = Newest()
        self.plots = Plots()
        self.refusals: dict[str, str] = {}
        """By service: the last message that it refused since it was first heard, and why."""
        self._num_refused: dict[str, int] = {}
        self._begin()

    def _begin(self) -> None:
        self.voxels = Voxels()
        self.truth = Truth()
        self._trail = Trail()
        self._painted: tuple[dict[str, Surface], Points | None] = ({}, None)
        self._painted_s = 0.0
        self.world_error = ""

    def let_go(self) -> None:
        """Nobody looks any more: begin anew when somebody does."""
        self.newest = Newest()
        self._begin()

    def add_target(self, told: TargetPose | TargetEstimate) -> None:
        """Take in where the target is; the truth wins over an estimate."""
        known = self.newest.target
        if isinstance(told, TargetEstimate) and isinstance(known, TargetPose):
            return
        self.newest.target = told
        pose = told.pose.matrix()
        self._trail.add(told.t_ns * 1e-9, pose[:3, 3])

    def add_state(self, state: SimState) -> None:
        """Take in the true state of an instant."""
        self.truth.add(state)

    def add_status(self, status: ServiceStatus, now_s: float) -> None:
        """Take in a heartbeat."""
        self.plots.add_status(status, now_s)
        name = f"{status.service}/{status.instance}"
        before = self._num_refused.setdefault(name, status.bad_messages)
        if status.bad_messages > before:
            self.refusals[name] = status.bad_reason
        elif status.bad_messages < before:
            self.refusals.pop(name, None)  # Another process under the same name.
        self._num_refused[name] = status.bad_messages

    def update_map(self, mirror: MapMirror) -> None:
        """Take over what a mirror of the map holds."""
        held = mirror.latest
        if held is None:
            self.voxels = Voxels()
        elif held is not self.voxels.held:
            self.voxels.update(held, mirror.voxels)

    def frame(self, options: Options, images: Mapping[int, Image]) -> Frame:
        """Return what is to be drawn now."""
        made = frame(self.newest, self.voxels, self._trail, options, images)
        if not (options.truth or options.coverage):
            return made
        held = self.voxels.held
        try:
            if options.coverage:
                painted, ghosts = self._paint()
                return replace(made, painted=painted, ghosts=ghosts)
            truth = self.truth.surface(None if held is None else held.tick)
            self.world_error = ""
            return replace(made, truth=truth)
        except WorldError as error:
            self.world_error = str(error)
            return made

    def _paint(self) -> tuple[dict[str, Surface], Points | None]:
        now_s = time.monotonic()
        if now_s - self._painted_s >= _PAINT_PERIOD_S:
            self._painted = self.truth.painted(self.voxels, self.newest.infos)
            self._painted_s, self.world_error = now_s, ""
        return self._painted
