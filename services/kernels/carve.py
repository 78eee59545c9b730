"""Free space of a depth image: every voxel projected once, whole bricks where that suffices."""

import numpy as np
from numba import njit

from services.kernels.bricks import (
    UNIFORM,
    VOXELS,
    close_brick,
    miss_brick,
    open_brick,
)
from services.kernels.cull import HIT, NEAR_M, WHOLE
from services.kernels.fade import refresh
from services.kernels.levels import EXACT, NUM_EXACT, NUM_FINE, RIM_CELLS, RIM_PX
from services.kernels.marks import miss_some, spare


@njit(cache=True, error_model="numpy", nogil=True)
def project(centre, offsets, pixel, bound, shift, plane, rim, pitch, reach, index, depth):  # type: ignore[no-untyped-def]
    """Write for each of 512 voxels where to look in a plane, and the raw reach that would free it.

    Args:
        centre: (3,) brick, offsets: (3, 512) its voxels, camera frame, m.
        pixel: (4,) fx, fy, cx, cy in the plane's cells, bound: (2,) width, height in cells.
        shift: (2,) along u and v, added before rounding down. plane: where it begins.
        rim: cells around the image in the plane. reach: (2,) raw depth per m, margin in raw depth.
            All float32 but plane and pitch; index int32, depth float32, written.
    """
    x, y, z = centre[0], centre[1], centre[2]
    ox, oy, oz = offsets[0], offsets[1], offsets[2]
    fx, fy, cx, cy = pixel[0], pixel[1], pixel[2] + rim, pixel[3] + rim
    width, height = bound[0] + rim + rim - np.float32(1), bound[1] + rim + rim - np.float32(1)
    shift_u, shift_v = shift[0], shift[1]
    per_m, margin = reach[0], reach[1]
    never, first = np.float32(1e9), np.int32(plane)
    for i in range(VOXELS):
        d = z + oz[i]
        inverse = np.float32(1) / d
        u = (x + ox[i]) * fx * inverse + cx
        v = (y + oy[i]) * fy * inverse + cy
        seen = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (d > NEAR_M)
        cell = first + np.int32(v + shift_v) * pitch + np.int32(u + shift_u)
        index[i] = cell if seen else np.int32(0)
        depth[i] = d * per_m + margin if seen else never


@njit(cache=True, error_model="numpy", nogil=True)
def project_exactly(centre, offsets, camera, bound, edge, rim, shape, reach, index, depth):  # type: ignore[no-untyped-def]
    """As `project`, with the pixels whose centres lie within each voxel's own silhouette.

    Args:
        camera: (4,) fx, fy, cx, cy; bound: (2,) width, height in pixels. edge: (2,) float32 m, what
            of the silhouette lies along u and v. shape: (2,) int32 rows, columns of a plane.
    """
    x, y, z = centre[0], centre[1], centre[2]
    ox, oy, oz = offsets[0], offsets[1], offsets[2]
    fx, fy, cx, cy = camera[0], camera[1], camera[2] + rim, camera[3] + rim
    width, height = bound[0] + rim + rim - np.float32(2), bound[1] + rim + rim - np.float32(2)
    half_u, half_v = edge[0] * fx * np.float32(0.5), edge[1] * fy * np.float32(0.5)
    pitch, size = shape[1], shape[0] * shape[1]
    per_m, margin = reach[0], reach[1]
    never, one, zero = np.float32(1e9), np.int32(1), np.int32(0)
    for i in range(VOXELS):
        d = z + oz[i]
        inverse = np.float32(1) / d
        u = (x + ox[i]) * fx * inverse + cx
        v = (y + oy[i]) * fy * inverse + cy
        seen = (u >= 1) & (v >= 1) & (u < width) & (v < height) & (d > NEAR_M)
        # First and last pixel centre within: truncation rounds down what is positive.
        u0, u1 = np.int32(u - half_u * inverse) + one, np.int32(u + half_u * inverse)
        v0, v1 = np.int32(v - half_v * inverse) + one, np.int32(v + half_v * inverse)
        seen &= (u1 >= u0) & (v1 >= v0)
        u0, v0 = max(u0, zero), max(v0, zero)
        plane = min(u1 - u0, one) + np.int32(2) * min(v1 - v0, one)
        cell = plane * size + v0 * pitch + u0
        index[i] = cell if seen else np.int32(0)
        depth[i] = d * per_m + margin if seen else never


@njit(cache=True, error_model="numpy", nogil=True)
def compare(planes, index, depth, raw, free):  # type: ignore[no-untyped-def]
    """Write 1 into free where the sight reaches beyond the voxel; return how many.

    Args:
        planes: uint16, raw reach, looked up at index. raw: (512,) int32, scratch.
    """
    # A loop of its own: nothing else is vectorised beside 16 bit loads.
    for i in range(VOXELS):
        raw[i] = np.int32(planes[np.uint32(index[i])])
    count = np.int32(0)
    for i in range(VOXELS):
        free[i] = np.int32(depth[i] < np.float32(raw[i]))
    for i in range(VOXELS):
        count += free[i]
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def count_closed(bricks, listed, first, end):  # type: ignore[no-untyped-def]
    """Return how many of the listed bricks in first .. end - 1 may need a slot."""
    count = 0
    for n in range(listed.size):
        brick = listed[n]
        count += int((first <= brick < end) and bricks.slot[brick] == UNIFORM)
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def carve(bricks, listed, offsets, sights, camera, size, edge, reach, flags, number, marks, update):  # type: ignore[no-untyped-def]
    """Free the voxels of the listed bricks that the image sees beyond; write `bricks` in place.

    Args:
        listed: which, kind, centre, level of bricks, as `cull` wrote them.
        offsets: (3, 512) float32, voxels of a brick, camera frame, m. sights: see `Sights`.
        camera: (4,) float32 fx, fy, cx, cy. size: (2,) height, width.
        edge: (2,) float32, m, of a voxel's silhouette along u and v.
        reach: (2,) float32, raw depth per m, margin in raw depth.
        flags: (B,) uint8, HIT where the image ends in the brick: there number: (B,) int32 is the
            row of marks: (N, WORDS) uint64, the voxels that it hits.
        update: hit, miss, low, high in 1/8192.
    """
    # Taken out of the tuples once: numba counts references at every access.
    which, kinds, centres, chosen = listed
    fine, fine_shape, coarse, coarse_shape, windows = sights
    slots, log_odds, dirty = bricks.slot, bricks.log_odds, bricks.dirty
    fades = bricks.clock[1] < np.inf
    _, miss, low, _ = update
    index, raw = np.empty(VOXELS, np.int32), np.empty(VOXELS, np.int32)
    free = np.empty(VOXELS, np.int32)
    depth, pixel = np.empty(VOXELS, np.float32), np.empty(4, np.float32)
    bound, shift = np.empty(2, np.float32), np.empty(2, np.float32)
    half = np.float32(0.5)
    for q in range(which.size):
        brick, level = which[q], chosen[q]
        if kinds[q] == WHOLE:
            refresh(bricks, brick)
            miss_brick(bricks, brick, miss, low)
            continue
        is_fine = level < NUM_FINE
        scale = np.float32(1) if is_fine else half
        planes = fine if is_fine else coarse
        rim = np.float32(RIM_PX if is_fine else RIM_CELLS)
        bound[0], bound[1] = np.float32(size[1]) * scale, np.float32(size[0]) * scale
        if level == EXACT:
            project_exactly(
                centres[q], offsets, camera, bound, edge, rim, fine_shape, reach, index, depth
            )
        else:
            pixel[0], pixel[1] = camera[0] * scale, camera[1] * scale
            pixel[2], pixel[3] = (camera[2] + half) * scale, (camera[3] + half) * scale
            # Windows of an even number of cells are centred on corners.
            shift[0] = half if windows[level, 1] % 2 == 0 else np.float32(0)
            shift[1] = half if windows[level, 0] % 2 == 0 else np.float32(0)
            pitch = fine_shape[1] if is_fine else coarse_shape[1]
            size_of_plane = pitch * (fine_shape[0] if is_fine else coarse_shape[0])
            number_of_plane = level - 1 + NUM_EXACT if is_fine else level - NUM_FINE
            plane = np.int32(number_of_plane * size_of_plane)
            project(
                centres[q], offsets, pixel, bound, shift, plane, rim, pitch, reach, index, depth
            )
        seen = compare(planes, index, depth, raw, free)
        if seen == 0:
            continue
        if fades:
            refresh(bricks, brick)
        hit = flags[brick] & HIT != 0
        if seen == VOXELS and not hit:
            miss_brick(bricks, brick, miss, low)
            continue
        slot = slots[brick]
        if slot == UNIFORM:
            slot = open_brick(bricks, brick)
        if hit:
            spare(free, marks[number[brick]])
        dirty[brick] = 1
        if miss_some(log_odds[slot], free, miss, low) == 0:
            close_brick(bricks, brick, np.int16(low))
