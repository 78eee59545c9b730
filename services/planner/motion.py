"""Moving frames: the target's motion, and views carried along by it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray, inverse, rotation_exp


@dataclass(frozen=True)
class Motion:
    """A frame and how it moves; velocities in the axes of the parent frame.

    N frames of one parent are one motion of (N, 4, 4), (N, 3), (N, 3): `stacked`, `each`.
    """

    T: FloatArray
    """(4, 4) parent from frame, metres."""
    linear: FloatArray
    """(3,) velocity of the frame's origin, m/s."""
    angular: FloatArray
    """(3,) rad/s."""

    def predicted(self, dt_s: float) -> "Motion":
        """Go on for `dt_s` with the twist that the frame feels itself: a unicycle drives an arc.

        Source: the exponential map of SE(3); Ma, Soatto, Kosecka, Sastry, eq. 2.36.
        """
        R = self.T[:3, :3]
        turn = (R.T @ self.angular) * dt_s
        shift = _left_jacobian(turn) @ (R.T @ self.linear) * dt_s
        T = np.eye(4)
        T[:3, :3] = R @ rotation_exp(turn)
        T[:3, 3] = self.T[:3, 3] + R @ shift
        turned = T[:3, :3] @ R.T
        return Motion(T, turned @ self.linear, turned @ self.angular)

    def carry(self, local: "Motion") -> "Motion":
        """Lift a motion, or N, given in this frame to the parent; exact, whatever both do."""
        R = self.T[:3, :3]
        arm = local.T[..., :3, 3] @ R.T
        return Motion(
            T=self.T @ local.T,
            linear=self.linear + np.cross(self.angular, arm) + local.linear @ R.T,
            angular=self.angular + local.angular @ R.T,
        )

    def seen_from(self, frame: "Motion") -> "Motion":
        """Return this motion, or N, as seen in a moving frame: `frame.carry` undone."""
        R = frame.T[:3, :3]
        arm = self.T[..., :3, 3] - frame.T[:3, 3]
        linear = self.linear - frame.linear - np.cross(frame.angular, arm)
        return Motion(
            T=inverse(frame.T) @ self.T,
            linear=linear @ R,
            angular=(self.angular - frame.angular) @ R,
        )

    def each(self) -> tuple["Motion", ...]:
        """Take N frames apart."""
        parts = zip(self.T, self.linear, self.angular, strict=True)
        return tuple(Motion(T, linear, angular) for T, linear, angular in parts)


def still(T: FloatArray) -> Motion:
    """Return a frame, or N, resting in its parent."""
    rest = np.zeros((*T.shape[:-2], 3))
    return Motion(T, rest, rest)


def stacked(motions: Sequence[Motion]) -> Motion:
    """Put frames of one parent together."""
    if not motions:
        return still(np.empty((0, 4, 4)))
    return Motion(
        np.array([each.T for each in motions]),
        np.array([each.linear for each in motions]),
        np.array([each.angular for each in motions]),
    )


def _left_jacobian(w: FloatArray) -> FloatArray:
    """Return the (3, 3) mean of exp(s w) for s in [0, 1]; Taylor below 1e-4 rad."""
    angle = float(np.linalg.norm(w))
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if angle < 1e-4:  # The next term is below 1e-17.
        a, b = 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    else:
        a, b = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    jacobian: FloatArray = np.eye(3) + a * W + b * (W @ W)
    return jacobian
