"""What is in the array of a message, in a few words; never the array itself."""

import numpy as np

from schemas.camera import ColorImage
from schemas.cloud import INVALID, NO_RETURN, DepthCloud, XyzCloud
from schemas.map import FREE, OCCUPIED, UNKNOWN, MapChanges, MapFull
from schemas.message import ArrayMessage


def array_words(message: ArrayMessage) -> str:
    """Describe an array: its size and what its numbers mean."""
    match message:
        case DepthCloud():
            return _depth(message)
        case XyzCloud():
            return _points(message)
        case ColorImage():
            return f"JPEG {message.width} x {message.height}, {size(len(message.array))}"
        case MapChanges():
            return _changes(message)
        case MapFull():
            known = message.array.nbytes
            return f"{len(message.array)} bricks of 8 x 8 x 8 voxels, {size(known)}"
        case _:
            shape = " x ".join(str(side) for side in message.shape)
            return f"{shape} of {message.dtype}, {size(message.array.nbytes)}"


def size(num_bytes: float) -> str:
    """Say a number of bytes with three digits."""
    for unit in ("B", "kB", "MB"):
        if num_bytes < 999.5:
            return f"{num_bytes:.3g} {unit}"
        num_bytes /= 1000
    return f"{num_bytes:.3g} GB"


def _depth(message: DepthCloud) -> str:
    depth = message.array
    back = depth[(depth != INVALID) & (depth != NO_RETURN)]
    nothing = np.count_nonzero(depth == NO_RETURN)
    height, width = depth.shape
    words = f"depth {width} x {height}, {back.size / depth.size:.1%} returned"
    if back.size:
        near_m, far_m = back.min() * message.depth_scale_m, back.max() * message.depth_scale_m
        words += f" from {near_m:.3g} to {far_m:.3g} m"
    return f"{words}, {nothing / depth.size:.1%} looked at nothing"


def _points(message: XyzCloud) -> str:
    points = message.array
    good = points[np.isfinite(points).all(axis=1)]
    words = f"{len(points)} points, {len(points) - len(good)} invalid"
    if not len(good):
        return words
    distance_m = np.linalg.norm(good, axis=1)
    return f"{words}, {distance_m.min():.3g} to {distance_m.max():.3g} m away"


def _changes(message: MapChanges) -> str:
    counts = [np.count_nonzero(message.classes == kind) for kind in (OCCUPIED, FREE, UNKNOWN)]
    return (
        f"{len(message.array)} voxels changed: {counts[0]} to occupied, {counts[1]} to free, "
        f"{counts[2]} to unknown"
    )
