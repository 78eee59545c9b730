"""The state of the simulated world: an integer tick, the target, the cameras."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from services.kernels.rigid import FloatArray
from services.simulator.actuator import Actuator, Body, carried_out
from services.world.path import Motion, Unicycle

_NO_TWIST = np.zeros(6)


class World:
    """Target and cameras at one tick; time is `tick * dt_ns`, exactly."""

    def __init__(self, motion: Motion, dt_ns: int, actuator: Actuator) -> None:
        self.motion = motion
        self.dt_ns = dt_ns
        self.actuator = actuator
        self.tick = 0
        self.num_clipped = 0
        """Commands above the limits, since the start."""
        self.num_sideways = 0
        """Commands of which wheels could not do a part."""
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
        self.tick, self.num_clipped, self.num_sideways, self.cameras = 0, 0, 0, {}

    def spawn(
        self, camera: int, T_world_camera: FloatArray, camera_yaw_rad: float | None = None
    ) -> None:
        """Put a camera into the world, at rest; one that is there stays as it is.

        Args:
            camera: its index.
            T_world_camera: (4, 4), optical frame.
            camera_yaw_rad: how it is fixed on its robot, if that has wheels; None: it flies.
        """
        on_wheels = camera_yaw_rad is not None
        body = Body(T_world_camera, _NO_TWIST, camera_yaw_rad or 0.0, on_wheels)
        self.cameras.setdefault(camera, body)

    def placed(self) -> set[str]:
        """Return the names of the cameras that are there."""
        return {f"camera/{camera}" for camera in self.cameras}

    def remove(self, camera: int) -> None:
        """Take a camera out of the world."""
        self.cameras.pop(camera, None)

    def mount(self, camera: int, camera_yaw_rad: float | None) -> None:
        """Put a camera on a robot with wheels, turned so against its heading; None: it flies."""
        body = self.cameras.get(camera)
        if body is None or (camera_yaw_rad is None and not body.on_wheels):
            return
        if camera_yaw_rad is None:
            self.cameras[camera] = replace(body, on_wheels=False)
        else:
            self.cameras[camera] = replace(body, on_wheels=True, camera_yaw_rad=camera_yaw_rad)

    def advance(self, commands: Mapping[int, FloatArray]) -> None:
        """Move every camera for one tick by its command; without one it stands still.

        Args:
            commands: camera to (6,) linear m/s and angular rad/s, world axes.
        """
        dt_s = self.dt_ns * 1e-9
        for camera, body in self.cameras.items():
            command = commands.get(camera, _NO_TWIST)
            step = carried_out(self.actuator, body, command, camera, self.tick, dt_s)
            self.num_clipped += step.clipped
            self.num_sideways += step.sideways
            self.cameras[camera] = step.body
        self.tick += 1
