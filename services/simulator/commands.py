"""The cameras' newest velocity commands."""

import time
from dataclasses import dataclass

import numpy as np

from schemas.camera import CameraCommand
from services.kernels.rigid import FloatArray


@dataclass(frozen=True)
class _Newest:
    tick: int
    came_s: float
    """Monotonic wall clock."""
    twist: FloatArray


class Commands:
    """Keeps one command per camera: (6,) linear m/s and angular rad/s, world axes."""

    def __init__(self) -> None:
        self._newest: dict[int, _Newest] = {}

    def put(self, command: CameraCommand) -> None:
        """Take the place of the camera's command before."""
        twist = np.array([*command.twist.linear, *command.twist.angular])
        self._newest[command.camera] = _Newest(command.tick, time.monotonic(), twist)

    def of_tick(self, tick: int) -> dict[int, FloatArray]:
        """Return those that answer this very tick."""
        return {camera: c.twist for camera, c in self._newest.items() if c.tick == tick}

    def not_older_than(self, age_s: float) -> dict[int, FloatArray]:
        """Return those that came in the last `age_s` seconds."""
        oldest_s = time.monotonic() - age_s
        return {camera: c.twist for camera, c in self._newest.items() if c.came_s >= oldest_s}
