"""How fast robots on wheels may change places while a target carries them along."""

import numpy as np

from services.planner.formed import Formed, Joined
from services.planner.here import Here

SHARE = 0.2
"""Of the speed at which the target carries a robot: arcsin of it, 12 degrees, is how far the change
turns its course, and with that what it sees, aside."""
_IN_PLACE_M = 0.01
_SLOWEST_MPS = 0.01
"""With a target that stands nobody can step aside: places are changed when it goes on."""


def sideways(before: Joined, after: Formed, here: Here) -> float:
    """Return the speed, m/s, that a change adds at most; infinite if all led robots stay.

    Robots that come from elsewhere do not count: they must overtake, and see the target later.
    """
    led = before.led
    if not led:
        return np.inf
    start, end = (each.at(here.target, here.t_s) for each in (before, after))
    ways_m = np.linalg.norm(end.T[led, :3, 3] - start.T[led, :3, 3], axis=1)
    if ways_m.max() < _IN_PLACE_M:
        return np.inf
    carried = here.target.carry(end).linear[led, :2]
    slowest_mps = float(np.linalg.norm(carried, axis=1).min())
    return max(SHARE * slowest_mps, _SLOWEST_MPS)
