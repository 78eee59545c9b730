"""Depth images of spheres, boxes and upright cylinders on a plate, by analytic ray casting."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Pinhole = tuple[float, float, float, float]

NOISE_M = 0.0005
NOISE_PER_M2 = 0.0012
HOLES = 0.01
NO_RETURN = 65535
SCALE_M = 0.001


@dataclass(frozen=True)
class Solids:
    """What stands in a scene, world frame, m."""

    spheres: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    """(N, 4) x, y, z, radius."""
    boxes: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    """(N, 6) two opposite corners."""
    cylinders: FloatArray = field(default_factory=lambda: np.empty((0, 5)))
    """(N, 5) x, y, lower z, upper z, radius; no caps."""
    plate_half_m: float = 1.2
    """Half edge of the plate at z = 0."""


TOYS = Solids(
    np.array([[0.0, 0.0, 0.16, 0.16], [0.13, 0.02, 0.33, 0.09], [-0.22, 0.18, 0.06, 0.06]]),
    # The second is a thin wall.
    np.array([[-0.1, -0.3, 0.0, 0.1, -0.2, 0.12], [0.25, 0.1, 0.0, 0.28, 0.3, 0.3]]),
)


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


def rays(shape: tuple[int, int], pinhole: Pinhole, T: FloatArray) -> FloatArray:
    """Return (H, W, 3) world directions of unit depth."""
    fx, fy, cx, cy = pinhole
    v, u = np.mgrid[: shape[0], : shape[1]]
    return np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(shape)], axis=-1) @ T[:3, :3].T


def cast(directions: FloatArray, eye: FloatArray, solids: Solids = TOYS) -> FloatArray:
    """Return (H, W) depth along the optical axis, m; infinite where nothing is."""
    depth = np.full(directions.shape[:2], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -eye[2] / directions[..., 2]
        ground = eye + t[..., None] * directions
        on_plate = (t > 0) & (np.abs(ground[..., :2]) < solids.plate_half_m).all(axis=-1)
        depth[on_plate] = t[on_plate]
        for x, y, z, radius in solids.spheres:
            nearer(depth, _round(directions, eye - (x, y, z), radius))
        for corners in solids.boxes:
            low, high = (corners[:3] - eye) / directions, (corners[3:] - eye) / directions
            enter = np.minimum(low, high).max(axis=-1)
            leave = np.maximum(low, high).min(axis=-1)
            nearer(depth, np.where(enter < leave, enter, np.nan))
        for x, y, low_m, high_m, radius in solids.cylinders:
            t = _round(directions[..., :2], eye[:2] - (x, y), radius)
            z = eye[2] + t * directions[..., 2]
            nearer(depth, np.where((z >= low_m) & (z <= high_m), t, np.nan))
    return depth


def _round(directions: FloatArray, offset: FloatArray, radius: float) -> FloatArray:
    """Return where rays enter a circle or sphere around the origin; NaN if they pass by."""
    squared, b = (directions**2).sum(axis=-1), directions @ offset
    root = np.sqrt(b * b - squared * (offset @ offset - radius * radius))
    entered: FloatArray = (-b - root) / squared
    return entered


def nearer(depth: FloatArray, t: FloatArray) -> None:
    """Write t into depth where it is before the camera and nearer."""
    closer = (t > 0) & (t < depth)
    depth[closer] = t[closer]


def measured(
    depth: FloatArray, rng: np.random.Generator, empty: int = NO_RETURN
) -> NDArray[np.uint16]:
    """Return a noisy depth image in millimetres; holes are 0.

    Args:
        depth: (H, W) true depth, m; infinite where nothing returns, NaN where nothing is known.
        empty: what a pixel without return becomes.
    """
    holes = np.isnan(depth) | (rng.random(depth.shape) < HOLES)
    seen = np.isfinite(depth)
    depth = np.where(seen, depth, 0.0)
    depth += rng.normal(size=depth.shape) * (NOISE_M + NOISE_PER_M2 * depth**2)
    image = np.where(seen, np.round(depth / SCALE_M), empty)
    image[holes] = 0
    return image.astype(np.uint16)


def depth_image(
    shape: tuple[int, int],
    pinhole: Pinhole,
    T: FloatArray,
    rng: np.random.Generator,
    empty: int = NO_RETURN,
) -> NDArray[np.uint16]:
    """Return what a camera measures of TOYS."""
    return measured(cast(rays(shape, pinhole, T), T[:3, 3]), rng, empty)


def points(image: NDArray[np.uint16], pinhole: Pinhole, T: FloatArray) -> FloatArray:
    """Return the (N, 3) returns of an image, world frame, m."""
    v, u = np.nonzero((image > 0) & (image < NO_RETURN))
    z = image[v, u] * SCALE_M
    fx, fy, cx, cy = pinhole
    camera = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1)
    return camera @ T[:3, :3].T + T[:3, 3]
