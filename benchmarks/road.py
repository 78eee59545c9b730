"""A road of any length to drive along: level ground, boxes and balls beside it, depth images."""

import numpy as np

WIDTH, HEIGHT = 160, 120
FOCAL_PX = 80.0
PINHOLE = (FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
RANGE_M = 7.0
"""Depth that the camera believes; what it tells lies within 10 m along every axis."""
SCALE_M = 0.001
NO_RETURN = 65535
SPACING_M = 3.0


class Road:
    """Along x; one thing every three metres on each side, always the same for a seed."""

    def __init__(self, length_m: float, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        at_m = np.arange(-20.0, length_m + 20.0, SPACING_M)
        count = len(at_m)
        self.size_m = rng.uniform(0.3, 1.6, (2 * count, 3))
        side = np.repeat([-1.0, 1.0], count)
        y = side * rng.uniform(2.5, 6.0, 2 * count)
        x = np.tile(at_m, 2) + rng.uniform(-1.0, 1.0, 2 * count)
        self.centre_m = np.stack([x, y, self.size_m[:, 2] / 2], axis=1)
        self.is_ball = rng.random(2 * count) < 0.5

    def depth(self, T_world_camera: np.ndarray) -> np.ndarray:
        """Return the (HEIGHT, WIDTH) uint16 depth image of a camera, in SCALE_M."""
        v, u = np.mgrid[:HEIGHT, :WIDTH].reshape(2, -1)
        fx, fy, cx, cy = PINHOLE
        pixels = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.size)])
        rays, eye = (T_world_camera[:3, :3] @ pixels).astype(np.float32), T_world_camera[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth_m = np.where(rays[2] < 0, -eye[2] / rays[2], np.inf)
            near = np.abs(self.centre_m[:, 0] - eye[0]) < 2.0 * RANGE_M
            for n in np.flatnonzero(near):
                meets = ball if self.is_ball[n] else box
                depth_m = np.minimum(depth_m, meets(rays, eye, self.centre_m[n], self.size_m[n]))
            raw = depth_m / SCALE_M
        return (
            np.where(raw < NO_RETURN - 1, raw, NO_RETURN).astype(np.uint16).reshape(HEIGHT, WIDTH)
        )


def ball(rays: np.ndarray, eye: np.ndarray, centre: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return where rays (3, N) enter a ball that touches its box's floor; inf if they miss."""
    a, b = (rays * rays).sum(axis=0), (eye - centre) @ rays
    c = ((eye - centre) ** 2).sum() - (size[2] / 2) ** 2
    root = np.sqrt(b * b - a * c)
    t = (-b - root) / a
    return np.where(t > 0, t, np.inf)


def box(rays: np.ndarray, eye: np.ndarray, centre: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return where rays (3, N) enter a box; inf if they miss."""
    low = ((centre - size / 2 - eye)[:, None]) / rays
    high = ((centre + size / 2 - eye)[:, None]) / rays
    enter = np.minimum(low, high).max(axis=0)
    leave = np.maximum(low, high).min(axis=0)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def camera_at(x_m: float, yaw_rad: float = 0.0, pitch_rad: float = 0.0) -> np.ndarray:
    """Return T_world_camera of a camera 1.5 m above the road, looking along x.

    Args:
        x_m: how far along. yaw_rad: to the left. pitch_rad: down.
    """
    c, s, cp, sp = np.cos(yaw_rad), np.sin(yaw_rad), np.cos(pitch_rad), np.sin(pitch_rad)
    forward, right = np.array([c * cp, s * cp, -sp]), np.array([s, -c, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = x_m, 0.0, 1.5
    return T
