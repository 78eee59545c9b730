"""The classes that the world has been told, so that only what differs is told again."""

import numpy as np
from numpy.typing import NDArray

from services.kernels import classes
from services.kernels.bricks import MIXED, UNKNOWN, VOXELS
from services.mapper.brick_store import BrickStore
from services.mapper.sensor_model import SensorModel

_ROWS_PER_CALL = 128 * VOXELS


class Published:
    """Published classes of a store's voxels; at first everything is unknown."""

    def __init__(self, store: BrickStore) -> None:
        self._store = store
        num_bricks = store.bricks.slot.size
        # Zeroed pages cost nothing until a brick becomes mixed and is written.
        self._classes = np.zeros((num_bricks, VOXELS), np.uint8)
        self._value = np.zeros(num_bricks, np.uint8)
        self._rows = np.empty((_ROWS_PER_CALL, 4), np.int16)

    def changes(self) -> NDArray[np.int16]:
        """Publish: return (N, 4) rows i, j, k, class that differ from what was published."""
        parts, brick, total = [], 0, len(self._value)
        while brick < total:
            brick, count = classes.publish(
                self._store.bricks, self._classes, self._value, brick, self._rows
            )
            parts.append(self._rows[:count].copy())
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def bricks(self, sensor: SensorModel) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return (M, 3) indices and (M, 512) log-odds of the bricks published as known.

        A voxel that has changed its class since is given the log-odds of one hit or one miss.
        """
        shape = tuple(self._store.bricks.shape)
        index, log_odds = self._store.known()
        rows = np.ravel_multi_index(tuple(index.astype(np.int64).T), shape)
        gone = np.setdiff1d(np.flatnonzero(self._value), rows)
        rows = np.concatenate([rows, gone])
        unknown = np.full((len(gone), VOXELS), UNKNOWN, np.int16)
        now = np.concatenate([log_odds, unknown])
        value = self._value[rows]
        was = np.where((value == MIXED)[:, None], self._classes[rows], value[:, None])
        hit, miss, _, _ = sensor.fixed_point()
        once = np.array([UNKNOWN, miss, hit], np.int16)[was]
        is_class = np.where(now == UNKNOWN, 0, np.where(now >= 0, 2, 1))
        told = np.where(is_class == was, now, once)
        known = (told != UNKNOWN).any(axis=1)
        where = np.stack(np.unravel_index(rows[known], shape), axis=1)
        return where.astype(np.int16), told[known]
