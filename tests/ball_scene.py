"""Balls on the ground, seen by four noisy depth cameras."""

import numpy as np

PINHOLE = (110.0, 110.0, 79.5, 59.5)
EYES = [(0.0, -1.4, 0.5), (0.0, 1.4, 0.5), (-1.6, 0.1, 0.6), (1.6, -0.1, 0.6)]


def look_at(eye: tuple[float, ...]) -> np.ndarray:
    forward = np.array((0, 0, 0.2)) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    return T


def image(T: np.ndarray, balls: list[tuple[np.ndarray, float]], noise: np.ndarray) -> np.ndarray:
    """Depth of balls on the ground, mm; 65535 where nothing is nearer than 5 m."""
    v, u = np.mgrid[:120, :160]
    rays = np.stack([(u - 79.5) / 110, (v - 59.5) / 110, np.ones(u.shape)], axis=-1) @ T[:3, :3].T
    eye = T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
        for centre, radius in balls:
            a, b = (rays**2).sum(axis=-1), rays @ (eye - centre)
            root = b**2 - a * ((eye - centre) @ (eye - centre) - radius**2)
            near = np.where(root > 0, (-b - np.sqrt(root)) / a, np.inf)
            depth = np.minimum(depth, np.where(near > 0, near, np.inf))
    seen = np.where(depth < 5, depth, 0) + noise * 0.004
    return np.where(depth < 5, np.round(seen * 1000), 65535).astype(np.uint16)
