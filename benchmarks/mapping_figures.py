"""How two maps of the same box agree."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
LEAST = {"same": 0.999, "occupied": 0.995, "free": 0.97}
MOST_OVER = 0.005


@dataclass(frozen=True)
class Agreement:
    """Figures of our classes beside theirs."""

    same: float
    """Share of the voxels both know that have the same class."""
    occupied: float
    """Intersection over union."""
    free: float
    """Intersection over union."""
    over: float
    """Free here and unknown to them, over their free voxels."""

    @classmethod
    def of(cls, ours: NDArray[np.uint8], theirs: NDArray[np.uint8]) -> "Agreement":
        """Compare the classes of two dense maps."""
        both = (ours != UNKNOWN) & (theirs != UNKNOWN)
        over = ((ours == FREE) & (theirs == UNKNOWN)).sum() / (theirs == FREE).sum()
        return cls(
            float((ours == theirs)[both].mean()),
            overlap(ours == OCCUPIED, theirs == OCCUPIED),
            overlap(ours == FREE, theirs == FREE),
            float(over),
        )

    @property
    def holds(self) -> bool:
        """Whether the contract is kept."""
        return self.over <= MOST_OVER and all(
            getattr(self, name) >= least for name, least in LEAST.items()
        )

    def __str__(self) -> str:
        return (
            f"same class {self.same:.5f}, IoU occupied {self.occupied:.4f} free {self.free:.4f}, "
            f"over-carved {self.over:.2%}"
        )


def overlap(ours: NDArray[np.bool_], theirs: NDArray[np.bool_]) -> float:
    """Return intersection over union of two sets of voxels."""
    return float((ours & theirs).sum() / (ours | theirs).sum())
