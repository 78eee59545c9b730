"""Who is where in the world, and who comes too close to whom."""

import numpy as np
from numpy.typing import NDArray

from services.simulator.bodies import Bodies, Encounter
from services.simulator.proximity import Proximity
from services.simulator.world_state import World


class Traffic:
    """Watches the bodies of a world and counts their encounters.

    Args:
        target_corners_m: (K, 3) of the target's hull.
        clearance_m: nearer is too close.
    """

    def __init__(self, target_corners_m: NDArray[np.float32], clearance_m: float) -> None:
        self._bodies = Bodies(target_corners_m)
        self._clearance_m = clearance_m
        self._proximity = Proximity()

    def check(self, world: World) -> list[Encounter]:
        """Return who has begun to touch whom."""
        poses = {i: body.T_world_camera for i, body in world.cameras.items()}
        self._bodies.place(world.target().pose(), poses)
        return self._proximity.update(self._bodies.encounters(list(poses), self._clearance_m))

    def change_target(self, corners_m: NDArray[np.float32]) -> None:
        """Give the target another hull."""
        self._bodies.change_target(corners_m)

    def reset(self) -> None:
        """Count anew."""
        self._proximity = Proximity()

    def counts(self) -> dict[str, int]:
        """Return how often anybody touched, and came too close."""
        return {"contacts": self._proximity.num_contacts, "too_close": self._proximity.num_close}
