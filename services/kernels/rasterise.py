"""Draw a triangle mesh into a z-buffer.

Pixel centres lie at integer coordinates. Corners are snapped to 1/16384 px, which makes every edge
function an exact float64 (triangles up to 4096 px wide): with the top-left rule each pixel of a
closed surface belongs to exactly one of the triangles that share an edge, so there are no holes
(Pineda, A Parallel Algorithm for Polygon Rasterization, SIGGRAPH 1988).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_SUBPIXELS = 16384.0
_EXCLUSIVE = -0.25 / (_SUBPIXELS * _SUBPIXELS)  # between zero and the next edge value below.


@njit(cache=True, error_model="numpy", nogil=True)
def to_camera(
    vertices_world_m: NDArray[np.floating],
    T_world_camera: FloatArray,
    vertices_camera_m: FloatArray,
) -> None:
    """Fill `vertices_camera_m` (V, 3) with the (V, 3) world points seen from the camera."""
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    for i in range(vertices_world_m.shape[0]):
        x = vertices_world_m[i, 0] - t[0]
        y = vertices_world_m[i, 1] - t[1]
        z = vertices_world_m[i, 2] - t[2]
        for k in range(3):
            vertices_camera_m[i, k] = R[0, k] * x + R[1, k] * y + R[2, k] * z


@njit(cache=True, error_model="numpy", nogil=True)
def rasterise(
    vertices_camera_m: FloatArray,
    faces: NDArray[np.int32],
    intrinsics: FloatArray,
    near_m: float,
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
) -> None:
    """Draw the front faces into `depth_m` and `triangle` wherever they are nearer.

    Args:
        vertices_camera_m: (V, 3) in the optical frame (x right, y down, z forward).
        faces: (F, 3) vertex indices, counter-clockwise seen from outside; back faces are culled.
        intrinsics: (4,) fx, fy, cx, cy in pixels.
        near_m: what is nearer is cut away, triangles across it are clipped.
        depth_m: (H, W) depth along the optical axis, inf = nothing; updated in place.
        triangle: (H, W) row of `faces` seen; updated in place with `depth_m`.
    """
    num_vertices = vertices_camera_m.shape[0]
    screen = np.empty((num_vertices, 3))
    for i in range(num_vertices):
        _project(vertices_camera_m, i, intrinsics, screen)
    # Corners go by index and `_plane` is inlined: counted slices and calls cost 6x its arithmetic.
    cut, cut_screen, plane = np.empty((4, 3)), np.empty((4, 3)), np.empty(3)
    for f in range(faces.shape[0]):
        # The image's y points down, so that the outside's counter-clockwise becomes a, c, b.
        a, b, c = faces[f, 0], faces[f, 2], faces[f, 1]
        if not _plane(vertices_camera_m, a, b, c, intrinsics, plane):
            continue
        za, zb, zc = vertices_camera_m[a, 2], vertices_camera_m[b, 2], vertices_camera_m[c, 2]
        if za >= near_m and zb >= near_m and zc >= near_m:
            _draw(screen, a, b, c, plane, f, depth_m, triangle)
        elif za >= near_m or zb >= near_m or zc >= near_m:
            corners = _clip(vertices_camera_m, (a, b, c), near_m, cut)
            for k in range(corners):
                _project(cut, k, intrinsics, cut_screen)
            for k in range(2, corners):
                _draw(cut_screen, 0, k - 1, k, plane, f, depth_m, triangle)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _plane(
    points: FloatArray, a: int, b: int, c: int, intrinsics: FloatArray, plane: FloatArray
) -> bool:
    """Fill `plane` with p, q, r of 1/z = p u + q v + r; return whether it faces the camera.

    Taken before the corners are snapped: edge-on, a hundredth of a pixel is a millimetre.
    """
    x, y, z = points[a, 0], points[a, 1], points[a, 2]
    px, py, pz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
    qx, qy, qz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    offset = nx * x + ny * y + nz * z
    if not offset > 0.0:  # also for NaN.
        return False
    scale = 1.0 / offset
    plane[0], plane[1] = nx * scale / intrinsics[0], ny * scale / intrinsics[1]
    plane[2] = nz * scale - plane[0] * intrinsics[2] - plane[1] * intrinsics[3]
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _project(points: FloatArray, i: int, intrinsics: FloatArray, screen: FloatArray) -> None:
    """Write u, v (px, snapped) and 1/z (1/m) of a point into its row of `screen`."""
    inverse = 1.0 / points[i, 2]
    u = intrinsics[0] * points[i, 0] * inverse + intrinsics[2]
    v = intrinsics[1] * points[i, 1] * inverse + intrinsics[3]
    screen[i, 0] = np.rint(u * _SUBPIXELS) / _SUBPIXELS
    screen[i, 1] = np.rint(v * _SUBPIXELS) / _SUBPIXELS
    screen[i, 2] = inverse


@njit(cache=True, error_model="numpy", nogil=True)
def _clip(points: FloatArray, face: tuple[int, int, int], near_m: float, cut: FloatArray) -> int:
    """Cut a triangle at z = near; fill `cut` and return its corners, 3 or 4."""
    count = 0
    for k in range(3):
        p, q = face[k], face[(k + 1) % 3]
        if points[p, 2] >= near_m:
            cut[count] = points[p]
            count += 1
        if (points[p, 2] >= near_m) != (points[q, 2] >= near_m):
            # Always from the inside out: triangles that share the edge meet in the same point.
            inside, outside = (p, q) if points[p, 2] >= near_m else (q, p)
            s = (points[inside, 2] - near_m) / (points[inside, 2] - points[outside, 2])
            for j in range(2):
                cut[count, j] = points[inside, j] + s * (points[outside, j] - points[inside, j])
            cut[count, 2] = near_m
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _bias(du: float, dv: float) -> float:
    """Return what keeps pixels on a top or left edge, and drops them on the others."""
    return 0.0 if dv < 0.0 or (dv == 0.0 and du > 0.0) else _EXCLUSIVE


@njit(cache=True, error_model="numpy", nogil=True)
def _draw(
    screen: FloatArray,
    a: int,
    b: int,
    c: int,
    plane: FloatArray,
    face: int,
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
) -> None:
    """Draw one screen triangle, corners (u, v, 1/z) clockwise as seen in the image.

    1/z is linear in the image: taken from `plane`, held between the corners'.
    """
    height, width = depth_m.shape
    a_u, a_v, a_i = screen[a, 0], screen[a, 1], screen[a, 2]
    b_u, b_v, b_i = screen[b, 0], screen[b, 1], screen[b, 2]
    c_u, c_v, c_i = screen[c, 0], screen[c, 1], screen[c, 2]
    ab_u, ab_v = b_u - a_u, b_v - a_v
    bc_u, bc_v = c_u - b_u, c_v - b_v
    ca_u, ca_v = a_u - c_u, a_v - c_v
    if not ab_v * ca_u - ab_u * ca_v > 0.0:  # also for NaN.
        return
    first_u = int(np.ceil(max(min(a_u, b_u, c_u), 0.0)))
    last_u = int(np.floor(min(max(a_u, b_u, c_u), width - 1.0)))
    first_v = int(np.ceil(max(min(a_v, b_v, c_v), 0.0)))
    last_v = int(np.floor(min(max(a_v, b_v, c_v), height - 1.0)))
    if first_u > last_u or first_v > last_v:
        return
    bias_a, bias_b, bias_c = _bias(bc_u, bc_v), _bias(ca_u, ca_v), _bias(ab_u, ab_v)
    farthest, nearest = min(a_i, b_i, c_i), max(a_i, b_i, c_i)
    for v in range(first_v, last_v + 1):
        # Each edge function is zero on its edge and positive towards the corner opposite.
        at_a = bc_u * (v - b_v) - bc_v * (first_u - b_u)
        at_b = ca_u * (v - c_v) - ca_v * (first_u - c_u)
        at_c = ab_u * (v - a_v) - ab_v * (first_u - a_u)
        for u in range(first_u, last_u + 1):
            if at_a + bias_a >= 0.0 and at_b + bias_b >= 0.0 and at_c + bias_c >= 0.0:
                inverse = plane[0] * u + plane[1] * v + plane[2]
                z = np.float32(1.0 / min(max(inverse, farthest), nearest))
                if z < depth_m[v, u]:
                    depth_m[v, u] = z
                    triangle[v, u] = face
            at_a -= bc_v
            at_b -= ca_v
            at_c -= ab_v
