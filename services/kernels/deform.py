"""Bending a standing body by closed-form fields."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

BREATHING, SQUASH, BEND, TWIST, WAVE = range(5)
WAVE_CREST_COUNT = 2.0  # Crests on the body at one instant.


@njit(cache=True, error_model="numpy", nogil=True)
def deform(
    out: NDArray[np.float32],
    rest: NDArray[np.float32],
    height: float,
    kinds: NDArray[np.int64],
    amplitudes: NDArray[np.float64],
    angles: NDArray[np.float64],
) -> None:
    """Write the deformed vertices into `out`.

    The fields act one after the other on x and y; with q = z / height taken at rest and
    s = amplitude * sin(angle):

        breathing   (x, y) *= 1 + s 4 q (1 - q)
        squash      z *= 1 + s, (x, y) /= sqrt(1 + s)
        bend        x += s height q^2 / 2
        twist       (x, y) turned by s q
        wave        (x, y) *= 1 + amplitude q (2 - q) sin(2 pi 2 q - angle)

    The plane z = 0 is mapped to itself, what is above stays above. Squash, bend and twist keep
    the volume. Feet stay where they are, but for squash, which spreads them.

    Args:
        out: (V, 3), overwritten; may be `rest`.
        rest: (V, 3) the undeformed vertices, z up from 0.
        height: height at rest, same unit.
        kinds: (K,) of BREATHING ... WAVE.
        amplitudes: (K,) relative, or radians for bend (slope of the top) and twist (of the top).
        angles: (K,) 2 pi hz t + phase, rad.
    """
    signals = amplitudes * np.sin(angles)
    for i in range(rest.shape[0]):
        x, y, z = float(rest[i, 0]), float(rest[i, 1]), float(rest[i, 2])
        q = z / height
        for k in range(kinds.shape[0]):
            s = signals[k]
            if kinds[k] == BREATHING:
                swell = 1.0 + s * 4.0 * q * (1.0 - q)
                x, y = x * swell, y * swell
            elif kinds[k] == SQUASH:
                thin = 1.0 / np.sqrt(1.0 + s)
                x, y, z = x * thin, y * thin, z * (1.0 + s)
            elif kinds[k] == BEND:
                x += 0.5 * s * height * q * q
            elif kinds[k] == TWIST:
                c, d = np.cos(s * q), np.sin(s * q)
                x, y = c * x - d * y, d * x + c * y
            elif kinds[k] == WAVE:
                crest = np.sin(2.0 * np.pi * WAVE_CREST_COUNT * q - angles[k])
                swell = 1.0 + amplitudes[k] * q * (2.0 - q) * crest
                x, y = x * swell, y * swell
        out[i, 0], out[i, 1], out[i, 2] = x, y, z
