"""The colours of a film: light or dark, and distinct to those who see colours differently, too."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from services.kernels.light import Mood
from services.kernels.palette import VIRIDIS, linear

ThemeName = Literal["light", "dark"]


def _hex(text: str) -> NDArray[np.float64]:
    """Return the light (3,) of `rrggbb`."""
    return linear(np.array(list(bytes.fromhex(text))) / 255)


@dataclass(frozen=True, eq=False)
class Theme:
    """Colours as light, (3,) each; cameras, target and polygon are Okabe's and Ito's."""

    floor: NDArray[np.float64]
    grid: NDArray[np.float64]
    ground_voxel: NDArray[np.float64]
    camera: NDArray[np.float64]
    polygon: NDArray[np.float64]
    target: NDArray[np.float64]
    wedge: NDArray[np.float64]
    mood: Mood
    ink: str
    """Of text, `#rrggbb`."""
    faint_ink: str
    palette: NDArray[np.float64]
    """Of heights."""
    wedge_opacity: float


LIGHT = Theme(
    floor=_hex("e9ecef"),
    grid=_hex("b9c0c8"),
    ground_voxel=_hex("d3d8de"),
    camera=_hex("d55e00"),
    polygon=_hex("d55e00"),
    target=_hex("0072b2"),
    wedge=_hex("e69f00"),
    mood=Mood(
        sun=0.62,
        sky=0.5,
        bounce=0.45,
        smooth=0.7,
        zenith_rgb=_hex("fbfcfd"),
        horizon_rgb=_hex("eef1f4"),
    ),
    ink="#22272e",
    faint_ink="#5b6570",
    palette=VIRIDIS,
    wedge_opacity=0.09,
)
DARK = Theme(
    floor=_hex("262b33"),
    grid=_hex("454d59"),
    ground_voxel=_hex("3b424d"),
    camera=_hex("f0a030"),
    polygon=_hex("f0a030"),
    target=_hex("56b4e9"),
    wedge=_hex("f0a030"),
    mood=Mood(
        sun=0.8,
        sky=0.45,
        bounce=0.4,
        smooth=0.7,
        zenith_rgb=_hex("14171c"),
        horizon_rgb=_hex("1b1f26"),
    ),
    ink="#e8ecf1",
    faint_ink="#9aa5b1",
    palette=VIRIDIS,
    wedge_opacity=0.028,
)
THEMES: dict[str, Theme] = {"light": LIGHT, "dark": DARK}
