"""Colours for numbers that people who see colours differently can read, too.

viridis and magma, by van der Walt and Smith (matplotlib, CC0), as polynomials of the sixth degree
in each channel (fitted by M. Zucker, CC0): no more than 0.02 from matplotlib's tables.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

VIRIDIS = np.array([
    [0.2777273272, 0.0054073445, 0.3340998053],
    [0.1050930431, 1.4046135299, 1.3845901626],
    [-0.3308618287, 0.2148475595, 0.0950951630],
    [-4.6342304990, -5.7991009734, -19.3324409563],
    [6.2282699363, 14.1799333668, 56.6905526007],
    [4.7763849977, -13.7451453777, -65.3530326334],
    [-5.4354558559, 4.6458526122, 26.3124352496],
])  # fmt: skip
MAGMA = np.array([
    [-0.0021364851, -0.0007496551, -0.0053861279],
    [0.2516605407, 0.6775232437, 2.4940265993],
    [8.3537172792, -3.5777195150, 0.3144679030],
    [-27.6687330858, 14.2647307810, -13.6492131881],
    [52.1761398123, -27.9436060717, 12.9441694424],
    [-50.7685253647, 29.0465828213, 4.2341529938],
    [18.6557050659, -11.4897735200, -5.6019615087],
])  # fmt: skip


def colours(palette: NDArray[np.float64], share: ArrayLike) -> NDArray[np.float64]:
    """Return (..., 3) sRGB, 0 to 1, of numbers 0 to 1; what is beyond has the colour of the end."""
    s = np.clip(np.nan_to_num(np.asarray(share, np.float64)), 0.0, 1.0)[..., None]
    rgb = np.zeros((*s.shape[:-1], 3))
    for row in palette[::-1]:
        rgb = rgb * s + row
    return np.clip(rgb, 0.0, 1.0)


def linear(srgb: ArrayLike) -> NDArray[np.float64]:
    """Return the light, 0 to 1, that a screen gives for sRGB 0 to 1 (IEC 61966-2-1)."""
    told = np.asarray(srgb, np.float64)
    light: NDArray[np.float64] = np.where(
        told <= 0.04045, told / 12.92, ((told + 0.055) / 1.055) ** 2.4
    )
    return light
