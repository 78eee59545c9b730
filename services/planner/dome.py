"""The built-in dome of 48 views around an object of about 0.3 m."""

import numpy as np

from services.kernels.rigid import FloatArray, look_at

NUM_AZIMUTHS = 16
_SLOPE = 0.6 * np.sqrt(0.5)
# Horizontal distance, height and downward tilt of each ring: the dome with which next-best-view
# planners are compared (rpg_ig_active_reconstruction, dome_48_views).
RINGS = ((0.6, 0.15, 0.0), (0.6, 0.35, 0.0), (_SLOPE, 0.35 + _SLOPE, np.pi / 4))


def dome_views() -> list[FloatArray]:
    """Return 48 transforms (4, 4), target from optical frame, ring by ring, images upright."""
    return [
        _view(2 * np.pi * step / NUM_AZIMUTHS, *ring)
        for ring in RINGS
        for step in range(NUM_AZIMUTHS)
    ]


def _view(azimuth: float, level_m: float, height_m: float, tilt_rad: float) -> FloatArray:
    outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    eye = level_m * outward + np.array([0.0, 0.0, height_m])
    gaze = -np.cos(tilt_rad) * outward - np.array([0.0, 0.0, np.sin(tilt_rad)])
    return look_at(eye, eye + gaze)
