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

    Args:
        target_corners_m: (K, 3) of the hull, target frame; `hull_corners` of the mesh.
    """

    def __init__(self, target_corners_m: NDArray[np.float32]) -> None:
        try:
            import pybullet
        except ImportError as error:
            raise MissingExtra(
                "the simulator needs pybullet: pip install 'encircle[simulator]'"
            ) from error
        self._bullet = pybullet
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._ground = self._body(self._shape(pybullet.GEOM_PLANE))
        self._target = self._body(self._hull(target_corners_m))
        self._ball = self._shape(pybullet.GEOM_SPHERE, radius=CAMERA_RADIUS_M)
        self._cameras: dict[int, int] = {}

    def place(self, T_world_target: FloatArray, cameras: Mapping[int, FloatArray]) -> None:
        """Put the target and the cameras (index to T_world_camera) where they are now."""
        self._move(self._target, T_world_target)
        for camera in self._cameras.keys() - cameras.keys():
            self._bullet.removeBody(self._cameras.pop(camera), physicsClientId=self._client)
        for camera, T_world_camera in cameras.items():
            if camera not in self._cameras:
                self._cameras[camera] = self._body(self._ball)
            self._move(self._cameras[camera], T_world_camera)

    def change_target(self, corners_m: NDArray[np.float32]) -> None:
        """Give the target another hull; `place` it before anybody is measured."""
        self._bullet.removeBody(self._target, physicsClientId=self._client)
        self._target = self._body(self._hull(corners_m))

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

    def _hull(self, corners_m: NDArray[np.float32]) -> int:
        return self._shape(self._bullet.GEOM_MESH, vertices=corners_m.tolist())

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


def hull_corners(vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the (K, 3) of (V, 3) vertices that are farthest in evenly spread directions."""
    i = np.arange(_HULL_DIRECTIONS) + 0.5
    # Fibonacci's spiral on the sphere.
    polar, azimuth = np.arccos(1 - 2 * i / _HULL_DIRECTIONS), np.pi * (1 + 5**0.5) * i
    spread = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1
    )
    axes = np.concatenate([np.eye(3), -np.eye(3), spread]).astype(np.float32)
    # Axis by axis: all at once a million vertices would take a gigabyte.
    corners: NDArray[np.float32] = vertices[np.unique([np.argmax(vertices @ a) for a in axes])]
    return corners
