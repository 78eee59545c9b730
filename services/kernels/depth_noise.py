"""What a depth camera makes of the true depth: noise, dropout, uint16.

One law covers both models: the standard deviation of the depth z seen at incidence theta is
    sigma(z, theta) = constant + quadratic (z - offset)^2 + grazing / sqrt(z) g(theta)^2,
with g = theta / (pi/2 - theta), and the pixel looks astray by a normal of
lateral + lateral_grazing g pixels: edges roll (edge_jitter.py).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

RAW_INVALID = np.uint16(0)
RAW_NO_RETURN = np.uint16(65535)

_HALF_PI = np.float32(np.pi / 2)
_MAX_INCIDENCE = np.float32(np.radians(80.0))  # the models were measured up to about here.
_MIN_COSINE = np.float32(np.cos(np.radians(80.0)))
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
# acos(x) = sqrt(1 - x) (c0 + c1 x + ...), off by 7e-5: Abramowitz & Stegun, 4.4.45.
_C0, _C1, _C2, _C3 = (np.float32(c) for c in (1.5707288, -0.2121144, 0.0742610, -0.0187293))


class NoiseModel(NamedTuple):
    """Coefficients of the law above; metres and pixels."""

    constant_m: float = 0.0
    quadratic: float = 0.0
    offset_m: float = 0.0
    grazing: float = 0.0
    lateral_px: float = 0.0
    lateral_grazing_px: float = 0.0


# Nguyen, Izadi, Lovell, Modeling Kinect Sensor Noise ..., 3DIMPVT 2012.
NGUYEN = NoiseModel(0.0012, 0.0019, 0.4, 0.0001, 0.8, 0.035)


def d4xx(focal_px: float, baseline_m: float = 0.05, subpixel_px: float = 0.1) -> NoiseModel:
    """Return the noise of a stereo camera: sigma = z^2 s / (f B).

    Source: Intel, Tuning depth cameras for best performance; B and s as in Gazebo's D435 model.
    """
    return NoiseModel(quadratic=subpixel_px / (focal_px * baseline_m))


class Draws(NamedTuple):
    """Random numbers of one image: rows of a pool shared by all images, and where they start."""

    normals: NDArray[np.float32]
    uniforms: NDArray[np.float32]
    normal_starts: NDArray[np.int64]
    uniform_starts: NDArray[np.int64]
    salt: NDArray[np.int64]
    """Flat indices of the pixels that drop out for no reason."""


class NoisePool:
    """Random numbers drawn once; an image reads them from random offsets (4x faster)."""

    _SIZE = 1 << 20

    def __init__(self) -> None:
        rng = np.random.default_rng(np.random.SeedSequence([0x6E6F697365]))
        self._normals = rng.standard_normal(self._SIZE, np.float32)
        self._uniforms = rng.random(self._SIZE >> 2, np.float32)

    def draw(
        self, shape: tuple[int, int], salt_share: float, seed: int, camera: int, tick: int
    ) -> Draws:
        """Return the draws of one image: the same for the same arguments, in any process."""
        height, width = shape
        rng = np.random.default_rng(np.random.SeedSequence([seed, camera, tick]))
        return Draws(
            self._normals,
            self._uniforms,
            rng.integers(0, self._normals.size - width, height),
            rng.integers(0, self._uniforms.size - width, height),
            rng.integers(0, height * width, round(salt_share * height * width)),
        )


@njit(cache=True, error_model="numpy", nogil=True)
def quantise(
    depth_m: NDArray[np.float32],
    min_range_m: float,
    max_range_m: float,
    depth_scale_m: float,
    raw: NDArray[np.uint16],
) -> None:
    """Fill `raw` (H, W): depth / scale, 0 if too near, 65535 if beyond the range."""
    nearest, farthest = np.float32(min_range_m), np.float32(max_range_m)
    per_metre = np.float32(1.0 / depth_scale_m)
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            z = depth_m[v, u]
            value = np.uint16(min(z, farthest) * per_metre + _HALF)
            value = RAW_INVALID if z < nearest else value
            raw[v, u] = RAW_NO_RETURN if z > farthest else value


@njit(cache=True, error_model="numpy", nogil=True)
def mesh_cosines(
    vertices_camera_m: NDArray[np.float64],
    faces: NDArray[np.int32],
    cosines: NDArray[np.float32],
) -> None:
    """Fill `cosines` (F,): of the incidence at each face's centre; per face, it is smooth enough.

    Args:
        vertices_camera_m: (V, 3) in the optical frame.
        faces: (F, 3) vertex indices.
        cosines: (F,) out; negative for back faces.
    """
    for f in range(faces.shape[0]):
        a = vertices_camera_m[faces[f, 0]]
        b = vertices_camera_m[faces[f, 1]]
        c = vertices_camera_m[faces[f, 2]]
        px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        qx, qy, qz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        x, y, z = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
        square = (nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z)
        cosines[f] = -(nx * x + ny * y + nz * z) / np.sqrt(square + 1e-300)


@njit(cache=True, error_model="numpy", nogil=True)
def incidence_cosine(
    z: np.float32,
    face: int,
    face_cosines: NDArray[np.float32],
    camera_height_m: float,
    intrinsics: NDArray[np.float64],
    u: int,
    v: int,
) -> np.float32:
    """Return the cosine of the incidence at pixel (u, v): of its face, or else of the ground."""
    if face >= 0:
        cosine: np.float32 = face_cosines[face]
        return cosine
    x = (u - intrinsics[2]) / intrinsics[0]
    y = (v - intrinsics[3]) / intrinsics[1]
    return np.float32(abs(camera_height_m) / (z * np.sqrt(x * x + y * y + 1.0)))


@njit(cache=True, error_model="numpy", nogil=True)
def _row_cosines(
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    face_cosines: NDArray[np.float32],
    camera_height_m: float,
    intrinsics: NDArray[np.float64],
    v: int,
    cosines: NDArray[np.float32],
) -> None:
    """Fill `cosines` (W,) with row v's `incidence_cosine`, in two loops for SIMD's sake."""
    height = np.float32(abs(camera_height_m))
    y_square = np.float32(((v - intrinsics[3]) / intrinsics[1]) ** 2 + 1.0)
    step, start = np.float32(1.0 / intrinsics[0]), np.float32(-intrinsics[2] / intrinsics[0])
    for u in range(cosines.shape[0]):
        x = start + step * np.float32(u)
        cosines[u] = height / (depth_m[v, u] * np.sqrt(x * x + y_square))
    for u in range(cosines.shape[0]):
        face = triangle[v, u]
        if face >= 0:
            cosines[u] = face_cosines[face]


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def grazing_term(cosine: np.float32) -> np.float32:
    """Return theta / (pi/2 - theta), theta capped at 80 degrees."""
    x = min(max(cosine, _ZERO), _ONE)
    theta = np.sqrt(_ONE - x) * (_C0 + x * (_C1 + x * (_C2 + x * _C3)))
    theta = min(theta, _MAX_INCIDENCE)
    term: np.float32 = theta / (_HALF_PI - theta)
    return term


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def reported(
    true_z: np.float32,
    cosine: np.float32,
    normal: np.float32,
    uniform: np.float32,
    ranges: tuple[float, float, float],
    model: NoiseModel,
) -> np.uint16:
    """Return the raw value of one pixel.

    Surfaces beyond 80 degrees of incidence may drop out (0), and surely do at 90.
    """
    nearest, farthest = np.float32(ranges[0]), np.float32(ranges[1])
    z = min(true_z, farthest)
    g, beyond = grazing_term(cosine), z - np.float32(model.offset_m)
    sigma = np.float32(model.constant_m) + np.float32(model.quadratic) * beyond * beyond
    sigma += np.float32(model.grazing) * g * g / np.sqrt(z)
    noisy = z + sigma * normal
    value = np.uint16(min(max(noisy, _ZERO), farthest) * np.float32(1.0 / ranges[2]) + _HALF)
    lost = (noisy < nearest) | (cosine < uniform * _MIN_COSINE)
    value = RAW_INVALID if lost else value
    return RAW_NO_RETURN if max(true_z, noisy) > farthest else value


@njit(cache=True, error_model="numpy", nogil=True)
def add_noise(
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    face_cosines: NDArray[np.float32],
    camera_height_m: float,
    intrinsics: NDArray[np.float64],
    ranges: tuple[float, float, float],
    model: NoiseModel,
    draws: Draws,
    raw: NDArray[np.uint16],
) -> None:
    """Fill `raw` (H, W) with `depth_m` under the noise along the ray.

    Args:
        depth_m: (H, W) true depth along the optical axis, inf = nothing.
        triangle: (H, W) face seen, negative for the ground.
        face_cosines: (F,) as from `mesh_cosines`.
        camera_height_m: above the ground.
        intrinsics: (4,) fx, fy, cx, cy in pixels.
        ranges: minimum range, maximum range, depth scale in metres.
        model: law of the noise.
        draws: the image's random numbers.
        raw: (H, W) out; 0 = invalid, 65535 = nothing in range.
    """
    height, width = depth_m.shape
    cosines = np.empty(width, np.float32)
    for v in range(height):
        _row_cosines(depth_m, triangle, face_cosines, camera_height_m, intrinsics, v, cosines)
        normals = draws.normals[draws.normal_starts[v] :]
        uniforms = draws.uniforms[draws.uniform_starts[v] :]
        for u in range(width):
            raw[v, u] = reported(depth_m[v, u], cosines[u], normals[u], uniforms[u], ranges, model)


@njit(cache=True, error_model="numpy", nogil=True)
def drop_out(salt: NDArray[np.int64], raw: NDArray[np.uint16]) -> None:
    """Invalidate the pixels of `raw` (H, W) at the flat indices `salt`."""
    flat = raw.reshape(-1)
    for k in range(salt.shape[0]):
        flat[salt[k]] = RAW_INVALID
