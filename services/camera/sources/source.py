"""What a camera's source gives at an instant."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.sim import SceneSpec, SimState


@dataclass(frozen=True)
class Frame:
    """One look of a camera."""

    depth: NDArray[np.uint16]
    """(H, W) along the optical axis in units of the depth scale; 0 = invalid, 65535 = nothing."""
    jpeg: NDArray[np.uint8] | None
    """A colour picture, if one was asked for."""


class Source(Protocol):
    """Where a camera's images come from."""

    def prepare(self, scene: SceneSpec) -> None:
        """Make ready for a scene that is about to come; from any thread.

        Raises:
            WorldError: If it cannot be built here.
        """

    def capture(self, state: SimState, *, color: bool) -> Frame:
        """Look at the instant of `state`."""
