"""Poses and twists as they travel: metres, radians, right-handed (REP-103)."""

from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

WORLD = "world"
"""The fixed frame: z up, the ground at z = 0."""

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector3 = tuple[Coordinate, Coordinate, Coordinate]
"""x, y, z."""


def _unit(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    norm = sum(part * part for part in q) ** 0.5
    if abs(norm - 1.0) > 1e-3:
        raise ValueError(f"quaternion {q} has norm {norm:.6g}; it must be 1 (+-1e-3)")
    return q


Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_unit)]
"""x, y, z, w; unit norm."""


class Pose(BaseModel):
    """Where a frame is in its parent: p_parent = R(orientation) p_child + position."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    position: Vector3
    """Metres."""
    orientation: Quaternion

    @classmethod
    def from_matrix(cls, T: NDArray[np.float64]) -> Self:
        """Build from a (4, 4) rigid transform; the quaternion has w >= 0.

        Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
        """
        m = T[:3, :3]
        trace = float(np.trace(m))
        candidates = np.array([m[0, 0], m[1, 1], m[2, 2], trace])
        largest = int(np.argmax(candidates))
        q = np.empty(4)
        if largest == 3:
            q[3] = 1.0 + trace
            q[0], q[1], q[2] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
        else:
            i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
            q[i] = 1.0 + 2.0 * m[i, i] - trace
            q[j], q[k], q[3] = m[j, i] + m[i, j], m[k, i] + m[i, k], m[k, j] - m[j, k]
        q /= np.linalg.norm(q) * (1.0 if q[3] >= 0 else -1.0)
        x, y, z = (float(part) for part in T[:3, 3])
        return cls(position=(x, y, z), orientation=tuple(float(part) for part in q))

    def matrix(self) -> NDArray[np.float64]:
        """Return the (4, 4) transform of this pose."""
        x, y, z, w = np.asarray(self.orientation) / np.linalg.norm(self.orientation)
        T = np.eye(4)
        T[0, :3] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        T[1, :3] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        T[2, :3] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        T[:3, 3] = self.position
        return T


class Twist(BaseModel):
    """Velocity of a frame's origin and its rotation, both in the axes of the message's frame."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    linear: Vector3
    """m/s."""
    angular: Vector3
    """rad/s."""
