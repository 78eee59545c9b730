"""Several circles, one above the other, every camera tilted to the centre."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.kernels.rigid import FloatArray
from services.planner.motion import Motion
from services.planner.plan import Plan, carried
from services.planner.ring import ring_angles
from services.planner.spherical import resting


class RingsSettings(BaseModel):
    """The rings, in the frame of the target."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    rings: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    lowest_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    """Elevation of the lowest ring, seen from the centre."""
    highest_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    """Elevation of the highest one; the others lie evenly between."""
    centre_height_m: Annotated[float, Field(ge=0)]


class Rings:
    """Circles of constant scale at several heights; a rigid body that the target carries."""

    rests = True

    def __init__(self, settings: RingsSettings) -> None:
        self._radius_m = settings.radius_m
        self._centre = np.array([0.0, 0.0, settings.centre_height_m])
        # No ring stays empty; a single one is the lowest.
        num_rings = min(settings.rings, settings.cameras)
        levels = np.linspace(settings.lowest_rad, settings.highest_rad, num_rings)
        counts = shared(settings.cameras, np.cos(levels))
        # Every other ring is turned by half a step, so that it looks between the others' cameras.
        theta = [
            ring_angles(count) + np.pi / count * (ring % 2) for ring, count in enumerate(counts)
        ]
        places = resting(
            np.full(settings.cameras, settings.radius_m),
            np.concatenate(theta),
            np.repeat(levels, counts),
        )
        self._local = places.gazing(self._centre)

    def plan(self, target: Motion, t_s: float) -> Plan:  # noqa: ARG002 the rings never change.
        """Carry the rings along with the target."""
        return carried(target, self._local, self._centre, self._radius_m, is_polygon=False)


def shared(num: int, weights: FloatArray) -> list[int]:
    """Share `num` things in proportion to weights, at least one each.

    Source: the highest averages of Sainte-Lague, from one seat each.
    """
    counts = np.ones(len(weights), np.int64)
    for _ in range(num - len(weights)):
        counts[np.argmax(weights / (2 * counts + 1))] += 1
    return [int(count) for count in counts]
