"""Checks of what comes in; each error names the value and the rule."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.mapper.errors import BadDepth, BadIntrinsics, BadPoints, BadPose

_RIGID_TOLERANCE = 1e-3  # as loose as the unit norm of a quaternion on the bus.


def rigid(T_map_camera: ArrayLike) -> NDArray[np.float64]:
    """Return a pose as float64.

    Raises:
        BadPose: If it is not a finite (4, 4) rigid motion.
    """
    T = np.asarray(T_map_camera, np.float64)
    if T.shape != (4, 4):
        raise BadPose(f"pose has shape {T.shape}; it must be (4, 4)")
    if not np.isfinite(T).all():
        raise BadPose(f"pose {T.tolist()} must be finite")
    R = T[:3, :3]
    error = float(np.abs(R.T @ R - np.eye(3)).max())
    if error > _RIGID_TOLERANCE or np.linalg.det(R) < 0 or (T[3] != (0, 0, 0, 1)).any():
        raise BadPose(
            f"pose {T.tolist()} is no rigid motion: |R'R - I| = {error:.3g} must be at most "
            f"{_RIGID_TOLERANCE}, det R positive, the last row 0 0 0 1"
        )
    return T


def pinhole(intrinsics: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy.

    Raises:
        BadIntrinsics: If they are not four finite numbers with positive focal lengths.
    """
    try:
        fx, fy, cx, cy = (float(value) for value in intrinsics)
    except (TypeError, ValueError) as error:
        raise BadIntrinsics(f"intrinsics {intrinsics!r} must be fx, fy, cx, cy") from error
    if not (math.isfinite(fx * fy * (1 + abs(cx) + abs(cy))) and fx > 0 and fy > 0):
        raise BadIntrinsics(f"fx {fx}, fy {fy}, cx {cx}, cy {cy}: finite, fx and fy positive")
    return fx, fy, cx, cy


def depth_image(depth: Any, scale_m: float, max_range_m: float) -> NDArray[np.uint16]:
    """Return a depth image whose rows are contiguous.

    Raises:
        BadDepth: If it is no (H, W) uint16 array, or scale or range are not positive and finite.
    """
    if not isinstance(depth, np.ndarray) or depth.ndim != 2 or depth.dtype != np.uint16:
        kind = f"{depth.dtype} {depth.shape}" if isinstance(depth, np.ndarray) else type(depth)
        raise BadDepth(f"depth is {kind}; it must be a uint16 array of shape (H, W)")
    if depth.size == 0:
        raise BadDepth(f"depth has shape {depth.shape}; it must have pixels")
    for name, value in (("depth scale", scale_m), ("maximum range", max_range_m)):
        if not (math.isfinite(value) and value > 0.0):
            raise BadDepth(f"{name} {value} m must be positive and finite")
    return _read_only(np.ascontiguousarray(depth))


def points(
    points_m: ArrayLike, origin_m: ArrayLike
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return points and the origin of their rays in single precision, as OctoMap takes them.

    Raises:
        BadPoints: If the points are not (N, 3) or the origin is not three finite numbers.
    """
    with np.errstate(over="ignore"):  # what overflows is not finite, hence skipped and counted.
        cloud = np.ascontiguousarray(points_m, np.float32)
        origin = np.ascontiguousarray(origin_m, np.float32)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise BadPoints(f"points have shape {cloud.shape}; it must be (N, 3)")
    if origin.shape != (3,) or not np.isfinite(origin).all() or np.abs(origin).max() > 1e6:
        raise BadPoints(f"ray origin {origin.tolist()} m must be x, y, z within 1e6 m")
    return _read_only(cloud), origin


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view: what comes off the bus is, and numba compiles for one of the two."""
    view = array.view()
    view.setflags(write=False)
    return view
