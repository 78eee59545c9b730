"""What a frame consists of; whoever draws needs to know no message."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.viewer.colours import Colours, Rgb

Points32 = NDArray[np.float32]
Faces = NDArray[np.int32]
Image = NDArray[np.uint8]
"""(H, W, 3) RGB."""


@dataclass(frozen=True)
class Points:
    """Squares of one size."""

    positions_m: Points32
    """(N, 3) in the frame of `T_world_points`."""
    colours: Colours
    """(N, 3)."""
    size_m: float
    T_world_points: FloatArray
    num_true: int
    """How many there are; N is less when there are too many to draw."""


@dataclass(frozen=True)
class Frustum:
    """A camera and what it sees."""

    camera: int
    T_world_camera: FloatArray
    vfov_rad: float
    aspect: float
    """Width by height."""
    colour: Rgb
    image: Image | None


@dataclass(frozen=True)
class Lines:
    """Segments, each with a colour at either end."""

    segments_m: Points32
    """(N, 2, 3) in the frame of `T_world_lines`."""
    colours: Colours
    """(N, 2, 3)."""
    T_world_lines: FloatArray
    """What goes with the target is given in its frame: a browser that is behind moves a thing at
    once and builds its new shape later."""


@dataclass(frozen=True)
class Surface:
    """Triangles of one colour."""

    vertices_m: Points32
    """(V, 3) in the frame of `T_world_surface`."""
    faces: Faces
    """(F, 3)."""
    T_world_surface: FloatArray


@dataclass(frozen=True)
class Frame:
    """Everything there is to draw at one moment; None and empty are not drawn."""

    voxels: Points | None = None
    frusta: tuple[Frustum, ...] = ()
    wedges: Surface | None = None
    rims: Lines | None = None
    """Of the wedges."""
    formation: Lines | None = None
    path: Lines | None = None
    trail: Lines | None = None
    """The last seconds of the path."""
    target: FloatArray | None = None
    """(4, 4) T_world_target."""
    middle_m: tuple[float, float] = (0.0, 0.0)
    """What of the ground is in the middle of the picture, world."""
    cloud: Points | None = None
    truth: Surface | None = None
    painted: dict[str, Surface] = field(default_factory=dict)
    """By class, see `painting.CLASSES`."""
    ghosts: Points | None = None
    dark: bool = False
