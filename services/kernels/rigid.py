"""Rigid motions as 4x4 matrices.

`T_a_b` maps points of frame b to frame a. Optical frames: x right, y down, z forward.
Source of the maps: Ma, Soatto, Kosecka, Sastry, An Invitation to 3-D Vision, ch. 2.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

# Below this sine between the view and `up` the image's right is lost in rounding.
_PARALLEL_SINE = 1e-9


def look_at(eye_m: ArrayLike, target_m: ArrayLike, up: Sequence[float] = (0, 0, 1)) -> FloatArray:
    """Place an optical frame at `eye_m` that looks at `target_m`, its image upright.

    Looking along `up` itself, the right of the image is that of a camera which got there by
    tilting from the view along x (along y, if `up` is x).

    Args:
        eye_m: (3,) where the camera is.
        target_m: (3,) what the optical axis meets.
        up: (3,) direction that points up in the image.

    Returns:
        (4, 4) T_world_camera.

    Raises:
        ValueError: If eye and target coincide or `up` is zero.
    """
    eye, up_axis = np.asarray(eye_m, np.float64), np.asarray(up, np.float64)
    view = np.asarray(target_m, np.float64) - eye
    distance, up_norm = float(np.linalg.norm(view)), float(np.linalg.norm(up_axis))
    if not (distance > 0.0 and np.isfinite(distance)):
        raise ValueError(
            f"look_at needs eye and target apart and finite, got {eye} and {eye + view}"
        )
    if not (up_norm > 0.0 and np.isfinite(up_norm)):
        raise ValueError(f"look_at needs a finite `up` other than zero, got {up}")
    forward, up_axis = view / distance, up_axis / up_norm
    right = np.cross(forward, up_axis)
    if np.linalg.norm(right) < _PARALLEL_SINE:
        ahead = (1.0, 0.0, 0.0) if abs(up_axis[0]) < 0.9 else (0.0, 1.0, 0.0)
        right = np.cross(ahead, up_axis)
        # `right` must stay square to the view where `up` was only nearly along it.
        right -= forward * float(right @ forward)
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = eye
    return T


def planar(x: float, y: float, heading: float) -> FloatArray:
    """Place a frame on the ground, its x axis turned by `heading` (rad) about z."""
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)


def optical_yaw(T_world_camera: FloatArray) -> float:
    """Return which way an upright camera looks, about the world's z from x, rad.

    Taken from the image's right, which is level however far the camera is tilted.
    """
    return float(np.arctan2(T_world_camera[0, 0], -T_world_camera[1, 0]))


def inverse(T: FloatArray) -> FloatArray:
    """Invert a rigid motion: T_b_a of T_a_b."""
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def apply(T: FloatArray, points: ArrayLike) -> FloatArray:
    """Map (..., 3) points by a rigid motion."""
    moved: FloatArray = np.asarray(points, np.float64) @ T[:3, :3].T + T[:3, 3]
    return moved


def rotation_exp(w: ArrayLike) -> FloatArray:
    """Rotate by the vector `w` (axis times angle, rad): Rodrigues' formula, (3, 3)."""
    x, y, z = np.asarray(w, np.float64)
    angle = np.sqrt(x * x + y * y + z * z)
    W = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    half_sinc = np.sinc(angle / (2 * np.pi))  # sin(angle/2) / (angle/2), also at zero.
    R: FloatArray = np.eye(3) + np.sinc(angle / np.pi) * W + 0.5 * half_sinc**2 * (W @ W)
    return R


def rotation_log(R: FloatArray) -> FloatArray:
    """Return the rotation vector of R, its length in [0, pi]; the inverse of `rotation_exp`.

    Goes through the quaternion with the largest component as pivot (Shepperd, 1978), which
    stays accurate at angles near zero and near pi.
    """
    trace = float(np.trace(R))
    pivot = int(np.argmax([trace, R[0, 0], R[1, 1], R[2, 2]]))
    skew = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    if pivot == 0:
        scalar, vector = 1.0 + trace, skew
    else:
        i = pivot - 1
        vector = R[i] + R[:, i]
        vector[i] = 1.0 + 2.0 * R[i, i] - trace
        scalar = float(skew[i])
    if scalar < 0.0:
        scalar, vector = -scalar, -vector
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        return np.zeros(3)
    w: FloatArray = vector * (2.0 * np.arctan2(length, scalar) / length)
    return w


def integrate_twist(
    T: FloatArray, linear_world: ArrayLike, angular_world: ArrayLike, dt: float
) -> FloatArray:
    """Move a frame for `dt` seconds by a constant twist given in world axes.

    Args:
        T: (4, 4) T_world_body at the start.
        linear_world: (3,) velocity of the body's origin, m/s.
        angular_world: (3,) angular velocity, rad/s.
        dt: duration, s.

    Returns:
        (4, 4) T_world_body at the end; exact for the constant twist.
    """
    out = T.copy()
    out[:3, :3] = rotation_exp(np.asarray(angular_world, np.float64) * dt) @ T[:3, :3]
    out[:3, 3] += np.asarray(linear_world, np.float64) * dt
    return out


def pose_error(T_a: FloatArray, T_b: FloatArray) -> tuple[float, float]:
    """Return how far two poses are apart: metres between origins, radians between axes."""
    angle = np.linalg.norm(rotation_log(T_a[:3, :3].T @ T_b[:3, :3]))
    return float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])), float(angle)
