"""The world's bodies in pybullet: who touches whom, who is too close."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from schemas.geometry import Pose
from services.kernels.rigid import FloatArray
from services.runtime.errors import MissingExtra

CAMERA_RADIUS_M = 0.05  # A small depth camera on a small drone's gimbal, rotors left out.
_HULL_DIRECTIONS = 200  # Points of the convex hull; bullet slows down with more.


@dataclass(frozen=True)
class Encounter:
    """Two bodies that touch (negative distance: overlap) or come too close."""

    one: str
    other: str
    distance_m: float


class Bodies:
    """A ground plane, the target's convex hull at rest and a ball per camera, all kinematic.

    The hull is that of the rest pose: a deforming body is met to within its amplitude.
    """

    def __init__(self, target_vertices_m: NDArray[np.float32], num_cameras: int) -> None:
        try:
            import pybullet
        except ImportError as error:
            raise MissingExtra(
                "the simulator needs pybullet: pip install 'encircle[simulator]'"
            ) from error
        self._bullet = pybullet
        self._client: int = pybullet.connect(pybullet.DIRECT)
        hull = self._shape(pybullet.GEOM_MESH, vertices=_extremes(target_vertices_m).tolist())
        self._ground = self._body(self._shape(pybullet.GEOM_PLANE))
        self._target = self._body(hull)
        ball = self._shape(pybullet.GEOM_SPHERE, radius=CAMERA_RADIUS_M)
        self._cameras = [self._body(ball) for _ in range(num_cameras)]

    def place(self, T_world_target: FloatArray, cameras: Mapping[int, FloatArray]) -> None:
        """Put the target and the cameras (index to T_world_camera) where they are now."""
        self._move(self._target, T_world_target)
        for camera, T_world_camera in cameras.items():
            self._move(self._cameras[camera], T_world_camera)

    def encounters(self, cameras: list[int], clearance_m: float) -> list[Encounter]:
        """Return all pairs with one of `cameras` that are nearer than `clearance_m`."""
        balls = {f"camera/{i}": self._cameras[i] for i in cameras}
        others = {"ground": self._ground, "target": self._target}
        pairs = [(a, b) for a in balls for b in others]
        pairs += [(a, b) for a in balls for b in balls if balls[a] < balls[b]]
        found = []
        for a, b in pairs:
            points = self._bullet.getClosestPoints(
                balls[a], {**others, **balls}[b], clearance_m, physicsClientId=self._client
            )
            if points:
                found.append(Encounter(a, b, min(float(point[8]) for point in points)))
        return found

    def close(self) -> None:
        """Leave pybullet."""
        if self._bullet.isConnected(self._client):
            self._bullet.disconnect(self._client)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _shape(self, kind: int, **measures: object) -> int:
        shape: int = self._bullet.createCollisionShape(
            kind, physicsClientId=self._client, **measures
        )
        return shape

    def _body(self, shape: int) -> int:
        body: int = self._bullet.createMultiBody(0, shape, physicsClientId=self._client)
        return body

    def _move(self, body: int, T: FloatArray) -> None:
        pose = Pose.from_matrix(T)
        self._bullet.resetBasePositionAndOrientation(
            body, pose.position, pose.orientation, physicsClientId=self._client
        )


def _extremes(vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the vertices that are farthest in evenly spread directions: a hull's corners."""
    i = np.arange(_HULL_DIRECTIONS) + 0.5
    # Fibonacci's spiral on the sphere.
    polar, azimuth = np.arccos(1 - 2 * i / _HULL_DIRECTIONS), np.pi * (1 + 5**0.5) * i
    spread = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1
    )
    axes = np.concatenate([np.eye(3), -np.eye(3), spread])
    corners: NDArray[np.float32] = vertices[np.unique(np.argmax(vertices @ axes.T, axis=0))]
    return corners
