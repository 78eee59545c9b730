"""Colour an image whose depth and triangles are known: Lambert light on noise textures.

The noise of the body is solid noise at the vertices' rest positions, so that it sticks to the
skin when the body deforms; the ground has squares of 10 cm and noise. Both are there for eyes
and for stereo matchers, which find nothing on plain walls.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_SQUARE_M = 0.1
_AMBIENT, _DIFFUSE = 0.4, 0.6
_SKY = (235.0, 215.0, 200.0)  # blue, green, red.
_SKIN = (170.0, 205.0, 240.0)
_GROUND = (150.0, 160.0, 150.0)
# Cycles per metre and share of each octave.
_OCTAVES = ((40.0, 0.45), (100.0, 0.35), (240.0, 0.2))


def noise_lattice(seed: int, size: int = 32) -> NDArray[np.float32]:
    """Return the (size, size, size) random values that `lattice_noise` blends; size = 2^n."""
    return np.random.default_rng(seed).random((size, size, size), np.float32)


@njit(cache=True, error_model="numpy", nogil=True)
def _blend(lattice: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Return the lattice's value at (x, y, z), trilinear and periodic."""
    mask = lattice.shape[0] - 1
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    u, v, w = x - i, y - j, z - k
    value = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                weight = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
                value += weight * lattice[(i + a) & mask, (j + b) & mask, (k + c) & mask]
    return value


@njit(cache=True, error_model="numpy", nogil=True)
def solid_noise(lattice: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Return the texture's brightness in [0, 1] at a point (metres)."""
    value = 0.0
    for hz, share in _OCTAVES:
        value += share * _blend(lattice, x * hz, y * hz, z * hz)
    return min(max(0.5 + 2.0 * (value - 0.5), 0.0), 1.0)


@njit(cache=True, error_model="numpy", nogil=True)
def bake(
    rest_m: NDArray[np.float32], lattice: NDArray[np.float32], albedo: NDArray[np.float32]
) -> None:
    """Fill `albedo` (V,) with the texture at the (V, 3) rest positions."""
    for i in range(rest_m.shape[0]):
        albedo[i] = solid_noise(lattice, rest_m[i, 0], rest_m[i, 1], rest_m[i, 2])


@njit(cache=True, error_model="numpy", nogil=True)
def vertex_normals(
    vertices_m: NDArray[np.float32], faces: NDArray[np.int32], normals: FloatArray
) -> None:
    """Fill `normals` (V, 3) with the unit normals of the smoothed surface."""
    normals[:] = 0.0
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        p = vertices_m[b] - vertices_m[a]
        q = vertices_m[c] - vertices_m[a]
        # Not normalised: large triangles weigh more.
        x, y, z = p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]
        for corner in (a, b, c):
            normals[corner, 0] += x
            normals[corner, 1] += y
            normals[corner, 2] += z
    for i in range(normals.shape[0]):
        x, y, z = normals[i]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            normals[i] /= length


@njit(cache=True, error_model="numpy", nogil=True)
def _weights(
    a: NDArray[np.float32], b: NDArray[np.float32], c: NDArray[np.float32], hit: FloatArray
) -> tuple[float, float, float]:
    """Return the barycentric coordinates of a point in the plane of a triangle."""
    px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    qx, qy, qz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    hx, hy, hz = hit[0] - a[0], hit[1] - a[1], hit[2] - a[2]
    pp, pq, qq = (
        px * px + py * py + pz * pz,
        px * qx + py * qy + pz * qz,
        qx * qx + qy * qy + qz * qz,
    )
    hp, hq = hx * px + hy * py + hz * pz, hx * qx + hy * qy + hz * qz
    scale = 1.0 / max(pp * qq - pq * pq, 1e-30)
    at_b, at_c = (qq * hp - pq * hq) * scale, (pp * hq - pq * hp) * scale
    return 1.0 - at_b - at_c, at_b, at_c


@njit(cache=True, error_model="numpy", nogil=True)
def shade(
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    vertices_world_m: NDArray[np.float32],
    faces: NDArray[np.int32],
    normals: FloatArray,
    albedo: NDArray[np.float32],
    lattice: NDArray[np.float32],
    light: FloatArray,
    T_world_camera: FloatArray,
    intrinsics: FloatArray,
    bgr: NDArray[np.uint8],
) -> None:
    """Fill `bgr` (H, W, 3) with the colours of what each pixel sees.

    Args:
        depth_m: (H, W) depth along the optical axis, inf = sky.
        triangle: (H, W) face seen, negative for the ground.
        vertices_world_m: (V, 3).
        faces: (F, 3).
        normals: (V, 3) unit, world.
        albedo: (V,) as from `bake`.
        lattice: as from `noise_lattice`.
        light: (3,) unit vector towards the light, world.
        T_world_camera: (4, 4).
        intrinsics: (4,) fx, fy, cx, cy in pixels.
        bgr: (H, W, 3) out.
    """
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    R, eye = T_world_camera[:3, :3], T_world_camera[:3, 3]
    hit = np.empty(3)
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            z = float(depth_m[v, u])
            if not np.isfinite(z):
                for k in range(3):
                    bgr[v, u, k] = np.uint8(_SKY[k])
                continue
            x, y = (u - cx) / fx, (v - cy) / fy
            for k in range(3):
                hit[k] = eye[k] + z * (R[k, 0] * x + R[k, 1] * y + R[k, 2])
            f = triangle[v, u]
            if f >= 0:
                a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
                at_a, at_b, at_c = _weights(
                    vertices_world_m[a], vertices_world_m[b], vertices_world_m[c], hit
                )
                value = at_a * albedo[a] + at_b * albedo[b] + at_c * albedo[c]
                lambert = 0.0
                for k in range(3):
                    normal = at_a * normals[a, k] + at_b * normals[b, k] + at_c * normals[c, k]
                    lambert += normal * light[k]
                tint = _SKIN
            else:
                value = 0.7 * solid_noise(lattice, 0.2 * hit[0], 0.2 * hit[1], 0.0)
                odd = (int(np.floor(hit[0] / _SQUARE_M)) + int(np.floor(hit[1] / _SQUARE_M))) & 1
                value += 0.3 * odd
                lambert = light[2]
                tint = _GROUND
            bright = (_AMBIENT + _DIFFUSE * max(lambert, 0.0)) * (0.25 + 0.75 * value)
            for k in range(3):
                bgr[v, u, k] = np.uint8(min(max(tint[k] * bright, 0.0), 255.0))
