"""The state of the simulated world: an integer tick, the target, the flying cameras."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from services.kernels.rigid import FloatArray, integrate_twist
from services.world.path import Motion, Unicycle

_NO_TWIST = np.zeros(6)


@dataclass(frozen=True)
class Limits:
    """What a camera's robot can do."""

    speed_m_s: float
    turn_rad_s: float


@dataclass(frozen=True)
class Body:
    """One camera in the world."""

    T_world_camera: FloatArray
    """(4, 4), optical frame."""
    twist: FloatArray
    """(6,) how it moved in the last tick: linear m/s, angular rad/s, world axes."""


class World:
    """Target and cameras at one tick; time is `tick * dt_ns`, exactly."""

    def __init__(self, motion: Motion, dt_ns: int, limits: Limits) -> None:
        self.motion = motion
        self.dt_ns = dt_ns
        self.limits = limits
        self.tick = 0
        self.num_clipped = 0
        """Commands above the limits, since the start."""
        self.cameras: dict[int, Body] = {}

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self.tick * self.dt_ns

    def target(self) -> Unicycle:
        """Return the target's state now."""
        return self.motion.at(self.t_ns * 1e-9)

    def reset(self) -> None:
        """Go back to tick 0, without cameras."""
        self.tick, self.num_clipped, self.cameras = 0, 0, {}

    def spawn(self, camera: int, T_world_camera: FloatArray) -> None:
        """Put a camera into the world, at rest; one that is there stays as it is."""
        self.cameras.setdefault(camera, Body(T_world_camera, _NO_TWIST))

    def advance(self, commands: Mapping[int, FloatArray]) -> None:
        """Fly every camera for one tick by its command; without one it stands still.

        Args:
            commands: camera to (6,) linear m/s and angular rad/s, world axes.
        """
        dt_s = self.dt_ns * 1e-9
        for camera, body in self.cameras.items():
            twist = self._within_limits(commands.get(camera, _NO_TWIST))
            T = integrate_twist(body.T_world_camera, twist[:3], twist[3:], dt_s)
            self.cameras[camera] = replace(body, T_world_camera=T, twist=twist)
        self.tick += 1

    def _within_limits(self, twist: FloatArray) -> FloatArray:
        linear = _shortened(twist[:3], self.limits.speed_m_s)
        angular = _shortened(twist[3:], self.limits.turn_rad_s)
        limited = np.concatenate([linear, angular])
        self.num_clipped += not np.array_equal(limited, twist)
        return limited


def _shortened(vector: FloatArray, limit: float) -> FloatArray:
    norm = float(np.linalg.norm(vector))
    return vector if norm <= limit else vector * (limit / norm)
