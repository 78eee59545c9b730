"""Depth images of spheres and boxes on a plate, by analytic ray casting: no mesh, no renderer."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SPHERES = np.array([[0.0, 0.0, 0.16, 0.16], [0.13, 0.02, 0.33, 0.09], [-0.22, 0.18, 0.06, 0.06]])
"""x, y, z, radius, m."""
BOXES = np.array([[-0.1, -0.3, 0.0, 0.1, -0.2, 0.12], [0.25, 0.1, 0.0, 0.28, 0.3, 0.3]])
"""Two opposite corners, m; the second is a thin wall."""
PLATE_HALF_M = 1.2
NOISE_M = 0.0005
NOISE_PER_M2 = 0.0012
HOLES = 0.01
NO_RETURN = 65535


def camera_pose(angle_rad: float, radius_m: float, height_m: float, aim_m: float) -> FloatArray:
    """Return T_world_camera on a ring, looking at (0, 0, aim_m)."""
    eye = np.array([radius_m * np.cos(angle_rad), radius_m * np.sin(angle_rad), height_m])
    forward = np.array([0.0, 0.0, aim_m]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :4] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    return T


def rays(
    shape: tuple[int, int], pinhole: tuple[float, float, float, float], T: FloatArray
) -> FloatArray:
    """Return (H, W, 3) world directions of unit depth."""
    fx, fy, cx, cy = pinhole
    v, u = np.mgrid[: shape[0], : shape[1]]
    return np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(shape)], axis=-1) @ T[:3, :3].T


def cast(directions: FloatArray, eye: FloatArray) -> FloatArray:
    """Return (H, W) depth along the optical axis, m; infinite where nothing is."""
    depth = np.full(directions.shape[:2], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -eye[2] / directions[..., 2]
        ground = eye + t[..., None] * directions
        on_plate = (t > 0) & (np.abs(ground[..., :2]) < PLATE_HALF_M).all(axis=-1)
        depth[on_plate] = t[on_plate]
        squared = (directions**2).sum(axis=-1)
        for x, y, z, radius in SPHERES:
            offset = eye - (x, y, z)
            b = directions @ offset
            root = b * b - squared * (offset @ offset - radius * radius)
            t = (-b - np.sqrt(root)) / squared
            depth = np.where((root > 0) & (t > 0), np.minimum(depth, t), depth)
        for corners in BOXES:
            low, high = (corners[:3] - eye) / directions, (corners[3:] - eye) / directions
            enter = np.minimum(low, high).max(axis=-1)
            leave = np.maximum(low, high).min(axis=-1)
            depth = np.where((enter < leave) & (enter > 0), np.minimum(depth, enter), depth)
    return depth


def depth_image(
    shape: tuple[int, int],
    pinhole: tuple[float, float, float, float],
    T: FloatArray,
    rng: np.random.Generator,
    empty: int = NO_RETURN,
) -> NDArray[np.uint16]:
    """Return a noisy depth image in millimetres with holes (0); `empty` where nothing returns."""
    depth = cast(rays(shape, pinhole, T), T[:3, 3])
    seen = np.isfinite(depth)
    depth = np.where(seen, depth, 0.0)
    depth += rng.normal(size=shape) * (NOISE_M + NOISE_PER_M2 * depth**2)
    image = np.where(seen, np.round(depth * 1000.0), empty)
    image[rng.random(shape) < HOLES] = 0
    return image.astype(np.uint16)


def points(
    image: NDArray[np.uint16], pinhole: tuple[float, float, float, float], T: FloatArray
) -> FloatArray:
    """Return the (N, 3) returns of an image, world frame, m."""
    v, u = np.nonzero((image > 0) & (image < NO_RETURN))
    z = image[v, u] * 0.001
    fx, fy, cx, cy = pinhole
    camera = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1)
    return camera @ T[:3, :3].T + T[:3, 3]
