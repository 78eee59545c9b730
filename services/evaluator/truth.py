"""The true surface at any instant, with its samples on it."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.evaluator.distance_memo import DistanceMemo
from services.evaluator.samples import Placed, place, sample
from services.evaluator.surface import BoolArray, Float32Array, Surface
from services.evaluator.views import admissible_eyes
from services.evaluator.visibility import observable

NUM_SAMPLES = 10_000  # On the 0.4 m bunny a sample stands for 0.3 of a 1 cm voxel's face.


@dataclass(frozen=True)
class Instant:
    """The surface at one instant, in the target frame."""

    surface: Surface
    placed: Placed
    distance: Callable[[ArrayLike], Float32Array]
    """Of (N, 3) points to the surface, metres."""


class Truth:
    """A surface that may deform, and the samples that ride on it.

    What is observable is found once, in the rest pose, and carried by the samples: it says which
    skin a camera could see of the undisturbed body, whatever fold hides it later.

    Args:
        rest_m: (V, 3) vertices in the rest pose, target frame.
        faces: (F, 3) outward triangles.
        deform: vertices at a time in seconds; None when the body is rigid, so that its tree is
            built once and not at every instant.
        radius_m: distance of admissible views from the body's centre.
        num_samples: how many.
        seed: of the samples.
    """

    def __init__(
        self,
        rest_m: NDArray[np.float32],
        faces: NDArray[np.int32],
        deform: Callable[[float], NDArray[np.float32]] | None,
        radius_m: float,
        num_samples: int = NUM_SAMPLES,
        seed: int = 0,
    ) -> None:
        surface = Surface(rest_m, faces)
        self._deform = deform
        self._samples = sample(surface, num_samples, seed)
        placed = place(self._samples, surface)
        self._rest = Instant(surface, placed, DistanceMemo(surface).distance)
        centre = np.array([0.0, 0.0, float(surface.vertices_m[:, 2].max()) / 2])
        self.observable: BoolArray = observable(surface, placed, admissible_eyes(centre, radius_m))
        """(N,) samples seen from at least one admissible view."""

    def deforming(self, deform: Callable[[float], NDArray[np.float32]] | None) -> "Truth":
        """Return the same body, with the same samples, that deforms in another way."""
        other = copy(self)
        other._deform = deform
        return other

    def at(self, t_s: float) -> Instant:
        """Return the surface at a time, seconds."""
        if self._deform is None:
            return self._rest
        surface = Surface(self._deform(t_s), self._rest.surface.faces)
        return Instant(surface, place(self._samples, surface), surface.distance)
