"""Cameras spread evenly over a cap of the sphere around the target."""

from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.kernels.rigid import FloatArray
from services.planner.motion import Motion
from services.planner.plan import Plan, carried
from services.planner.spherical import resting

_GOLDEN_RAD = np.pi * (3 - 5**0.5)
_ROUNDS = 300
_FIRST_STEP = 0.1
"""Of the relaxation, as a share of the mean spacing; it shrinks to nothing."""


_FALL = -4.0
"""Force over distance^2, with 1 / r^7: Coulomb's own would crowd the edges of the band."""


class SphereSettings(BaseModel):
    """The cap, in the frame of the target."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    lowest_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    highest_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    centre_height_m: Annotated[float, Field(ge=0)]


class Sphere:
    """Thomson's problem on a band of the sphere; a rigid body that the target carries."""

    rests = True

    def __init__(self, settings: SphereSettings) -> None:
        self._radius_m = settings.radius_m
        self._centre = np.array([0.0, 0.0, settings.centre_height_m])
        directions = spread(settings.cameras, settings.lowest_rad, settings.highest_rad)
        places = resting(
            np.full(settings.cameras, settings.radius_m),
            np.arctan2(directions[:, 1], directions[:, 0]),
            np.arcsin(directions[:, 2]),
        )
        self._local = places.gazing(self._centre)

    def plan(self, target: Motion, t_s: float) -> Plan:  # noqa: ARG002 the cap never changes.
        """Carry the cap along with the target."""
        return carried(target, self._local, self._centre, self._radius_m, is_polygon=False)


@lru_cache(maxsize=16)
def spread(num: int, lowest_rad: float, highest_rad: float) -> FloatArray:
    """Return (N, 3) unit directions, far from each other between two elevations.

    Fibonacci's spiral gives the start, equal in area; then each is pushed away from all others
    as in Thomson's problem (1904), in shrinking steps, and kept in the band. The same for ever,
    and kept: read only.
    """
    low, high = float(np.sin(lowest_rad)), float(np.sin(highest_rad))
    index = np.arange(num, dtype=np.float64)
    up = low + (high - low) * (index + 0.5) / num
    points = _on_sphere(up, _GOLDEN_RAD * index)
    spacing = np.sqrt(2 * np.pi * max(high - low, 1e-3) / num)
    for step in spacing * _FIRST_STEP * (1 - np.arange(_ROUNDS) / _ROUNDS):
        points = _kept(points + step * _push(points), low, high)
    points.flags.writeable = False
    return points


def _push(points: FloatArray) -> FloatArray:
    """Return (N, 3) directions of the force along the sphere, the strongest of length 1."""
    apart = points[:, None] - points[None]
    squares = np.einsum("ijk,ijk->ij", apart, apart)
    np.fill_diagonal(squares, np.inf)
    force = np.einsum("ijk,ij->ik", apart, squares**_FALL)
    force -= np.einsum("ik,ik->i", force, points)[:, None] * points
    strongest = float(np.sqrt(np.max(np.einsum("ik,ik->i", force, force))))
    pushed: FloatArray = force / max(strongest, 1e-12)
    return pushed


def _kept(points: FloatArray, low: float, high: float) -> FloatArray:
    up = points[:, 2] / np.linalg.norm(points, axis=1)
    return _on_sphere(np.clip(up, low, high), np.arctan2(points[:, 1], points[:, 0]))


def _on_sphere(up: FloatArray, theta: FloatArray) -> FloatArray:
    level = np.sqrt(np.maximum(0.0, 1 - up * up))
    return np.stack([level * np.cos(theta), level * np.sin(theta), up], axis=1)
