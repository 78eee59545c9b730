"""The map's clock: what is not seen again is forgotten, at the half-life's pace, when it matters.

See `services.kernels.fade`: time passes at no cost; bricks fade when they are written, when a voxel
of theirs expires, or when log-odds are asked for.
"""

from services.kernels import fade
from services.kernels.bricks import Bricks
from services.mapper.brick_store import BrickStore


class Fading:
    """Lets a store's time pass, and brings its bricks to the present for those who read them."""

    def __init__(self, store: BrickStore) -> None:
        self._store = store
        self._settled_s = 0.0
        """The time at which classes were last brought to the present."""

    def pass_time(self, dt_s: float, half_life_s: float) -> None:
        """Let time pass, in which log-odds halve every half_life_s; costs nothing per brick.

        Only another half-life than before fades every brick, up to when the old one ends.
        """
        bricks = self._store.bricks
        if bricks.clock[1] != half_life_s:
            fade.fade_all(bricks)
            fade.begin(bricks, half_life_s)
        bricks.clock[0] += dt_s

    def settled(self) -> Bricks:
        """Return the bricks with the classes of now: a comparison per brick if time has passed."""
        bricks = self._store.bricks
        if bricks.clock[0] != self._settled_s:
            fade.settle(bricks)
            self._settled_s = bricks.clock[0]
        return bricks

    def present(self) -> Bricks:
        """Return the bricks with the log-odds of now; fades every brick that is not."""
        fade.fade_all(self._store.bricks)
        return self._store.bricks
