"""The true surface of an instant, as the simulator tells it."""

from collections import deque

import numpy as np

from schemas.camera import CameraInfo
from schemas.sim import SimState
from services.kernels.rigid import FloatArray, apply, inverse
from services.viewer.painting import CLASSES, GHOST, View, paint
from services.viewer.primitives import Points, Points32, Surface
from services.viewer.voxels import MAX_DRAWN, Voxels

_STATES = 64  # Four seconds at the declared rate: more than any map is late.


class Truth:
    """Remembers the last states, so that a map is compared with the surface of its own instant."""

    def __init__(self) -> None:
        self._states: deque[SimState] = deque(maxlen=_STATES)

    def add(self, state: SimState) -> None:
        """Note a state; one of an earlier tick is a new run."""
        if self._states and state.tick < self._states[-1].tick:
            self._states.clear()
        self._states.append(state)

    def at(self, tick: int | None) -> SimState | None:
        """Return the state nearest to a tick, or the newest; None before the first."""
        if not self._states:
            return None
        if tick is None:
            return self._states[-1]
        return min(self._states, key=lambda state: abs(state.tick - tick))

    def surface(self, tick: int | None) -> Surface | None:
        """Return the surface at a tick.

        Raises:
            WorldError: If the object cannot be built here.
        """
        state = self.at(tick)
        if state is None:
            return None
        from services.world.scene import Scene  # Brings numba, for those alone who look at it.

        scene = Scene.from_spec(state.scene)
        vertices = scene.mesh_at(state.t_ns * 1e-9)
        return Surface(vertices, scene.faces, state.target.matrix())

    def painted(
        self, voxels: Voxels, cameras: dict[int, CameraInfo]
    ) -> tuple[dict[str, Surface], Points | None]:
        """Return the surface at the map's instant by class, and the ghosts.

        Raises:
            WorldError: If the object cannot be built here.
        """
        held = voxels.held
        state = None if held is None else self.at(held.tick)
        surface = None if held is None else self.surface(held.tick)
        if held is None or state is None or surface is None:
            return {}, None
        T_target_world = inverse(state.target.matrix())
        centres = apply(T_target_world @ held.pose.matrix(), voxels.centres_m)
        centres = centres[centres[:, 2] >= held.resolution_m]  # The ground is no ghost.
        views = [
            View(T_target_world @ body.pose.matrix(), cameras[body.camera].intrinsics)
            for body in state.cameras
            if body.camera in cameras
        ]
        classes, is_ghost = paint(
            surface.vertices_m, surface.faces, centres, held.resolution_m, views
        )
        parts = {
            name: Surface(
                surface.vertices_m, surface.faces[classes == code], surface.T_world_surface
            )
            for code, name in enumerate(CLASSES)
        }
        ghosts = centres[is_ghost].astype(np.float32)
        return parts, _ghosts(ghosts, held.resolution_m, state.target.matrix())


def _ghosts(centres_m: Points32, size_m: float, T_world_target: FloatArray) -> Points:
    drawn = centres_m[:MAX_DRAWN]
    colours = np.broadcast_to(np.array(GHOST, np.uint8), drawn.shape)
    return Points(drawn, colours, 1.5 * size_m, T_world_target, len(centres_m))
