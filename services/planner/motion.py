"""Moving frames: the target's motion, and views carried along by it."""

from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray, rotation_exp


@dataclass(frozen=True)
class Motion:
    """A frame and how it moves; velocities in the axes of the parent frame."""

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
        """Lift a motion given in this frame to the parent; exact, whatever both do."""
        R, arm = self.T[:3, :3], self.T[:3, :3] @ local.T[:3, 3]
        return Motion(
            T=self.T @ local.T,
            linear=self.linear + np.cross(self.angular, arm) + R @ local.linear,
            angular=self.angular + R @ local.angular,
        )


def still(T: FloatArray) -> Motion:
    """Return a frame that rests in its parent."""
    return Motion(T, np.zeros(3), np.zeros(3))


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
