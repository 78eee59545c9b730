"""Checks of what comes in; each error names the value and the rule."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels.bricks import VOXELS
from services.mapper.errors import (
    BadColor,
    BadDepth,
    BadIntrinsics,
    BadPoints,
    BadPose,
    BadRows,
    BadThreads,
    MapperError,
)

MAX_THREADS = 64
MAX_PIXELS = 1 << 24
"""Of a depth image, 4096 x 4096: what it sees is kept at every footprint."""
MAX_SIDE_PX = 8192
MAX_METRES = 1e6
"""Where a camera may be, as on the bus: farther away single precision tells no voxels apart."""
_SCALES_M = (1e-6, 1.0)  # per unit of depth; as on the bus.
_FOCAL_PX = (1e-3, 1e6)
_MAX_CENTRE_PX = 1e6
_POINTS = "points must be numbers of shape (N, 3)"
_RIGID_TOLERANCE = 1e-3  # as loose as the unit norm of a quaternion on the bus.


def numbers(
    values: Any, error: type[MapperError], rule: str, dtype: type[Any] = np.float64
) -> NDArray[Any]:
    """Return values as an array, or raise the error: they are no numbers, against the rule."""
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError) as reason:
        raise error(f"{rule}: {reason}") from reason


def number(value: Any, error: type[MapperError], name: str) -> float:
    """Return a value, or raise the error: it is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise error(f"{name} {value!r} must be a number")
    return float(value)


def rigid(T_map_camera: ArrayLike) -> NDArray[np.float64]:
    """Return a pose as float64.

    Raises:
        BadPose: If it is not a finite (4, 4) rigid motion.
    """
    T = numbers(T_map_camera, BadPose, "pose must be numbers of shape (4, 4)")
    if T.shape != (4, 4):
        raise BadPose(f"pose has shape {T.shape}; it must be (4, 4)")
    if not np.isfinite(T).all():
        raise BadPose(f"pose {T.tolist()} must be finite")
    R = T[:3, :3]
    skew = float(np.abs(R.T @ R - np.eye(3)).max())
    if skew > _RIGID_TOLERANCE or np.linalg.det(R) < 0 or (T[3] != (0, 0, 0, 1)).any():
        raise BadPose(
            f"pose {T.tolist()} is no rigid motion: |R'R - I| = {skew:.3g} must be at most "
            f"{_RIGID_TOLERANCE}, det R positive, the last row 0 0 0 1"
        )
    if np.abs(T[:3, 3]).max() > MAX_METRES:
        raise BadPose(f"pose is at {T[:3, 3].tolist()} m; it must be within {MAX_METRES:g} m")
    return T


def pinhole(intrinsics: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy.

    Raises:
        BadIntrinsics: If they are not four finite numbers, the focal lengths positive, none absurd.
    """
    try:
        fx, fy, cx, cy = (float(value) for value in intrinsics)
    except (TypeError, ValueError) as error:
        raise BadIntrinsics(f"intrinsics {intrinsics!r} must be fx, fy, cx, cy") from error
    low, high = _FOCAL_PX
    focal = all(low <= value <= high for value in (fx, fy))
    if not (focal and all(abs(value) <= _MAX_CENTRE_PX for value in (cx, cy))):
        raise BadIntrinsics(
            f"fx {fx}, fy {fy}, cx {cx}, cy {cy}: fx and fy must lie in {low:g} .. {high:g} px, "
            f"cx and cy within {_MAX_CENTRE_PX:g} px"
        )
    return fx, fy, cx, cy


def depth_image(depth: Any, scale_m: float, max_range_m: float) -> NDArray[np.uint16]:
    """Return a depth image whose rows are contiguous.

    Raises:
        BadDepth: If it is no (H, W) uint16 array of at most MAX_PIXELS, or scale or range are not
            positive and finite, or absurd.
    """
    if not isinstance(depth, np.ndarray) or depth.ndim != 2 or depth.dtype != np.uint16:
        kind = f"{depth.dtype} {depth.shape}" if isinstance(depth, np.ndarray) else type(depth)
        raise BadDepth(f"depth is {kind}; it must be a uint16 array of shape (H, W)")
    if not 0 < depth.size <= MAX_PIXELS or max(depth.shape) > MAX_SIDE_PX:
        raise BadDepth(
            f"depth has shape {depth.shape}; it must have 1 .. {MAX_PIXELS} pixels, at most "
            f"{MAX_SIDE_PX} along a side"
        )
    low, high = _SCALES_M
    scale_m = number(scale_m, BadDepth, "depth scale")
    max_range_m = number(max_range_m, BadDepth, "maximum range")
    if not low <= scale_m <= high:
        raise BadDepth(f"depth scale {scale_m} m must lie in {low:g} .. {high:g} m per unit")
    if not 0.0 < max_range_m <= MAX_METRES:
        raise BadDepth(
            f"maximum range {max_range_m} m must be positive and at most {MAX_METRES:g} m"
        )
    return _read_only(np.ascontiguousarray(depth))


def picture(color: Any, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the picture of a depth image of `shape` (H, W), its rows contiguous.

    Raises:
        BadColor: If it is no (H, W, 3) uint8 array.
    """
    wanted = (*shape, 3)
    if not isinstance(color, np.ndarray) or color.dtype != np.uint8 or color.shape != wanted:
        kind = f"{color.dtype} {color.shape}" if isinstance(color, np.ndarray) else type(color)
        raise BadColor(f"color is {kind}; it must be a uint8 array of shape {wanted}")
    return _read_only(np.ascontiguousarray(color))


def rows_of_three(points_m: ArrayLike) -> NDArray[np.float64]:
    """Return points as float64.

    Raises:
        BadPoints: If they are no numbers of shape (N, 3).
    """
    rows = np.ascontiguousarray(numbers(points_m, BadPoints, _POINTS))
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise BadPoints(f"points have shape {rows.shape}; it must be (N, 3)")
    return rows


def points(
    points_m: ArrayLike, origin_m: ArrayLike
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return points and the origin of their rays in single precision, as OctoMap takes them.

    Raises:
        BadPoints: If the points are not (N, 3) or the origin is not three finite numbers.
    """
    with np.errstate(over="ignore"):  # what overflows is not finite, hence skipped and counted.
        cloud = np.ascontiguousarray(numbers(points_m, BadPoints, _POINTS, np.float32))
        origin = numbers(origin_m, BadPoints, "ray origin must be x, y, z", np.float32)
        origin = np.ascontiguousarray(origin)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise BadPoints(f"points have shape {cloud.shape}; it must be (N, 3)")
    if origin.shape != (3,) or not np.isfinite(origin).all() or np.abs(origin).max() > MAX_METRES:
        raise BadPoints(f"ray origin {origin.tolist()} m must be x, y, z within {MAX_METRES:g} m")
    return _read_only(cloud), origin


def threads(count: int) -> int:
    """Return a number of threads.

    Raises:
        BadThreads: If it is not between 1 and MAX_THREADS.
    """
    if not isinstance(count, int) or not 1 <= count <= MAX_THREADS:
        raise BadThreads(f"threads {count!r} must be a whole number from 1 to {MAX_THREADS}")
    return count


def rows_at_once(most: int | None) -> None:
    """See to it that a brick's changes can be told at once; None is no limit.

    Raises:
        BadRows: If they cannot.
    """
    if most is not None and not (isinstance(most, int) and most >= VOXELS):
        raise BadRows(f"max_rows {most!r} must be a whole number, at least {VOXELS}: one brick's")


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view: what comes off the bus is, and numba compiles for one of the two."""
    view = array.view()
    view.setflags(write=False)
    return view
