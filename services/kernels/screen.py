"""The last steps from light to a picture: pictures within it, edges, mean and gamma."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_GAMMA_STEPS = 4096


@njit(cache=True, error_model="numpy", nogil=True)
def hang(
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    image: NDArray[np.float32],
    T_world_camera: FloatArray,
    intrinsics: FloatArray,
    T_image_world: FloatArray,
    image_intrinsics: FloatArray,
    opacity: float,
) -> None:
    """Blend what another camera sees into `rgb` wherever its image plane is seen.

    Args:
        rgb: (H, W, 3) changed in place.
        depth_m: (H, W) of the image plane.
        triangle: (H, W) not negative where the image plane is seen.
        image: (h, w, 3) the other camera's picture.
        T_world_camera: (4, 4) of the picture that is drawn.
        intrinsics: (4,) of the picture that is drawn, fx, fy, cx, cy.
        T_image_world: (4, 4) into the other camera's optical frame.
        image_intrinsics: (4,) of `image`.
        opacity: 0 to 1.
    """
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    gx, gy, dx, dy = (
        image_intrinsics[0], image_intrinsics[1], image_intrinsics[2], image_intrinsics[3],
    )  # fmt: skip
    rows, columns = image.shape[:2]
    T = T_image_world @ T_world_camera
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            if triangle[v, u] < 0:
                continue
            z = float(depth_m[v, u])
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            far = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            p = gx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / far + dx
            q = gy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / far + dy
            i = min(max(int(np.rint(p)), 0), columns - 1)
            j = min(max(int(np.rint(q)), 0), rows - 1)
            for k in range(3):
                rgb[v, u, k] += np.float32(opacity) * (image[j, i, k] - rgb[v, u, k])


@njit(cache=True, error_model="numpy", nogil=True)
def veil(
    rgb: NDArray[np.float32], triangle: NDArray[np.int32], colour: FloatArray, opacity: float
) -> None:
    """Blend a colour (3,) into `rgb` (H, W, 3) wherever `triangle` (H, W) is not negative."""
    for v in range(triangle.shape[0]):
        for u in range(triangle.shape[1]):
            if triangle[v, u] >= 0:
                for k in range(3):
                    rgb[v, u, k] += np.float32(opacity) * (np.float32(colour[k]) - rgb[v, u, k])


@njit(cache=True, error_model="numpy", nogil=True)
def outline(
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    triangle: NDArray[np.int32],
    step_m: float,
    reach_px: int,
    keep: float,
) -> None:
    """Darken what stands out: pixels beside which it goes back by more than `step_m`.

    Args:
        rgb: (H, W, 3) changed in place.
        depth_m: (H, W).
        triangle: (H, W); only where it is not negative.
        step_m: depth, m.
        reach_px: how far to look.
        keep: the share of its light that such a pixel keeps.
    """
    height, width = depth_m.shape
    for v in range(reach_px, height - reach_px):
        for u in range(reach_px, width - reach_px):
            if triangle[v, u] < 0:
                continue
            limit = depth_m[v, u] + step_m
            edges = (
                int(depth_m[v, u - reach_px] > limit) + int(depth_m[v, u + reach_px] > limit)
                + int(depth_m[v - reach_px, u] > limit) + int(depth_m[v + reach_px, u] > limit)
            )  # fmt: skip
            if edges:
                for k in range(3):
                    rgb[v, u, k] *= np.float32(keep)


def gamma_table() -> NDArray[np.uint8]:
    """Return what a screen is told of light 0 to 1: sRGB (IEC 61966-2-1)."""
    light = np.arange(_GAMMA_STEPS) / (_GAMMA_STEPS - 1)
    told = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    table: NDArray[np.uint8] = np.rint(255 * told).astype(np.uint8)
    return table


@njit(cache=True, error_model="numpy", nogil=True)
def develop(
    rgb: NDArray[np.float32], times: int, gamma: NDArray[np.uint8], picture: NDArray[np.uint8]
) -> None:
    """Fill `picture` (H, W, 3): the mean of `times` x `times` pixels of `rgb`, in sRGB."""
    scale = (len(gamma) - 1) / (times * times)
    for v in range(picture.shape[0]):
        for u in range(picture.shape[1]):
            for k in range(3):
                total = 0.0
                for j in range(times):
                    for i in range(times):
                        total += min(max(rgb[times * v + j, times * u + i, k], 0.0), 1.0)
                picture[v, u, k] = gamma[int(total * scale + 0.5)]
