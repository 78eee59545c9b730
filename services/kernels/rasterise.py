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
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    num_vertices = vertices_camera_m.shape[0]
    screen = np.empty((num_vertices, 3))
    for i in range(num_vertices):
        _project(vertices_camera_m[i], fx, fy, cx, cy, screen[i])
    polygon, plane = np.empty((4, 3)), np.empty(3)
    for f in range(faces.shape[0]):
        # The image's y points down, so that the outside's counter-clockwise becomes a, c, b.
        a, b, c = faces[f, 0], faces[f, 2], faces[f, 1]
        if not _plane(
            vertices_camera_m[a], vertices_camera_m[b], vertices_camera_m[c], intrinsics, plane
        ):
            continue
        za, zb, zc = vertices_camera_m[a, 2], vertices_camera_m[b, 2], vertices_camera_m[c, 2]
        if za >= near_m and zb >= near_m and zc >= near_m:
            _draw(screen[a], screen[b], screen[c], plane, f, depth_m, triangle)
        elif za >= near_m or zb >= near_m or zc >= near_m:
            corners = _clip(
                vertices_camera_m[a], vertices_camera_m[b], vertices_camera_m[c], near_m, polygon
            )
            for k in range(corners):
                _project(polygon[k], fx, fy, cx, cy, polygon[k])
            _draw(polygon[0], polygon[1], polygon[2], plane, f, depth_m, triangle)
            if corners == 4:
                _draw(polygon[0], polygon[2], polygon[3], plane, f, depth_m, triangle)


@njit(cache=True, error_model="numpy", nogil=True)
def _plane(
    a: FloatArray, b: FloatArray, c: FloatArray, intrinsics: FloatArray, plane: FloatArray
) -> bool:
    """Fill `plane` with p, q, r of 1/z = p u + q v + r; return whether it faces the camera.

    Taken before the corners are snapped: edge-on, a hundredth of a pixel is a millimetre.
    """
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    qx, qy, qz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    offset = nx * a[0] + ny * a[1] + nz * a[2]
    if not offset > 0.0:  # also for NaN.
        return False
    plane[0], plane[1] = nx / (fx * offset), ny / (fy * offset)
    plane[2] = nz / offset - plane[0] * cx - plane[1] * cy
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _project(
    point: FloatArray, fx: float, fy: float, cx: float, cy: float, screen: FloatArray
) -> None:
    """Write u, v (px, snapped) and 1/z (1/m) of a point into `screen`; they may be one array."""
    inverse = 1.0 / point[2]
    u = np.rint((fx * point[0] * inverse + cx) * _SUBPIXELS) / _SUBPIXELS
    v = np.rint((fy * point[1] * inverse + cy) * _SUBPIXELS) / _SUBPIXELS
    screen[0], screen[1], screen[2] = u, v, inverse


@njit(cache=True, error_model="numpy", nogil=True)
def _clip(a: FloatArray, b: FloatArray, c: FloatArray, near_m: float, polygon: FloatArray) -> int:
    """Cut a triangle at z = near; fill `polygon` and return its corners, 3 or 4."""
    count = 0
    for k in range(3):
        p, q = (a, b) if k == 0 else ((b, c) if k == 1 else (c, a))
        if p[2] >= near_m:
            polygon[count] = p
            count += 1
        if (p[2] >= near_m) != (q[2] >= near_m):
            # Always from the inside out: triangles that share the edge meet in the same point.
            inside, outside = (p, q) if p[2] >= near_m else (q, p)
            s = (inside[2] - near_m) / (inside[2] - outside[2])
            for j in range(2):
                polygon[count, j] = inside[j] + s * (outside[j] - inside[j])
            polygon[count, 2] = near_m
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def _bias(du: float, dv: float) -> float:
    """Return what keeps pixels on a top or left edge, and drops them on the others."""
    return 0.0 if dv < 0.0 or (dv == 0.0 and du > 0.0) else _EXCLUSIVE


@njit(cache=True, error_model="numpy", nogil=True)
def _draw(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    plane: FloatArray,
    face: int,
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
) -> None:
    """Draw one screen triangle, corners (u, v, 1/z) clockwise as seen in the image.

    1/z is linear in the image: taken from `plane`, held between the corners'.
    """
    height, width = depth_m.shape
    ab_u, ab_v = b[0] - a[0], b[1] - a[1]
    bc_u, bc_v = c[0] - b[0], c[1] - b[1]
    ca_u, ca_v = a[0] - c[0], a[1] - c[1]
    area = ab_v * ca_u - ab_u * ca_v
    if not area > 0.0:  # also false for NaN.
        return
    first_u = int(np.ceil(max(min(a[0], b[0], c[0]), 0.0)))
    last_u = int(np.floor(min(max(a[0], b[0], c[0]), width - 1.0)))
    first_v = int(np.ceil(max(min(a[1], b[1], c[1]), 0.0)))
    last_v = int(np.floor(min(max(a[1], b[1], c[1]), height - 1.0)))
    if first_u > last_u or first_v > last_v:
        return
    bias_a, bias_b, bias_c = _bias(bc_u, bc_v), _bias(ca_u, ca_v), _bias(ab_u, ab_v)
    farthest, nearest = min(a[2], b[2], c[2]), max(a[2], b[2], c[2])
    for v in range(first_v, last_v + 1):
        # Each edge function is zero on its edge and positive towards the corner opposite.
        at_a = bc_u * (v - b[1]) - bc_v * (first_u - b[0])
        at_b = ca_u * (v - c[1]) - ca_v * (first_u - c[0])
        at_c = ab_u * (v - a[1]) - ab_v * (first_u - a[0])
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
