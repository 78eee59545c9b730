"""Maps that leave the mapper's memory and come back."""

from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from services.kernels.bricks import BRICK, UNKNOWN
from services.mapper import formats
from services.mapper.archive import Nothing
from services.mapper.box import Box
from services.mapper.brick_store import clipped
from services.mapper.colors import Colors
from services.mapper.errors import BadMapFile
from services.mapper.readable_map import ReadableMap
from services.mapper.sensor_model import SensorModel
from services.mapper.stored_map import UNCOLORED, StoredMap, gathered


class StorableMap(ReadableMap):
    """What a VoxelMap has to do with files; it is built there."""

    def stored(self) -> StoredMap:
        """Return what is known, of window and archive, in the box of both.

        Raises:
            MapTooLarge: If window and archive lie in a box that no map may have.
        """
        stored = gathered(self.box, self.sensor, self._blocks())
        if not self.is_colored:
            return stored
        color = np.full((*stored.log_odds.shape, 3), UNCOLORED, np.uint8)
        window = self._colors.of_known(self._fading.present())
        color[: len(window)] = window  # Its bricks come first.
        color[stored.log_odds < 0] = UNCOLORED  # What has gone; octrees would not be pruned.
        return replace(stored, color=color)

    @classmethod
    def from_stored(cls, stored: StoredMap) -> Self:
        """Return a map of what is stored; only bricks that are not uniform keep their colors."""
        loaded = cls.__new__(cls)
        loaded._behind = Nothing()
        loaded._build(stored.box, stored.sensor)
        log_odds = clipped(stored.log_odds, *stored.sensor.fixed_point()[2:])
        loaded._store.restore(stored.bricks, log_odds)
        if stored.color is not None:
            palette = loaded._colors = Colors()
            index = tuple(stored.bricks.astype(np.int64).T)
            rows = np.ravel_multi_index(index, stored.box.num_bricks)
            palette.put(loaded._store.bricks, rows, stored.color)
        return loaded

    def take_in(self, stored: StoredMap) -> None:
        """Forget everything; know what is stored, in the window and, if there is one, the archive.

        Raises:
            BadMapFile: If the voxels differ in size or do not make up the window's bricks.
        """
        off = np.subtract(stored.box.first_key, self.box.first_key)
        if stored.box.resolution_m != self.box.resolution_m or (off % BRICK).any():
            raise BadMapFile(
                f"voxels of {stored.box.resolution_m} m in bricks from {stored.box.first_key} on "
                f"do not fit a window of {self.box.resolution_m} m and bricks from "
                f"{self.box.first_key} on: their keys must be the same but for multiples of {BRICK}"
            )
        self.clear()
        self._colors.forget(self._store.bricks)
        known = (stored.log_odds != UNKNOWN).any(axis=1)
        index = stored.bricks[known] + off // BRICK
        log_odds = clipped(stored.log_odds[known], *self.sensor.fixed_point()[2:])
        here = ((index >= 0) & (index < self.box.num_bricks)).all(axis=1)
        rows = np.ravel_multi_index(tuple(index[here].T), self.box.num_bricks)
        self._store.put(rows, log_odds[here])
        self._behind.keep(self.box, index[~here], log_odds[~here])
        if stored.color is not None:
            palette = self._colors = Colors()
            palette.put(self._store.bricks, rows, stored.color[known][here])

    def clear(self) -> None:
        """Forget everything."""
        raise NotImplementedError

    def save(self, path: str | Path) -> None:
        """Write the map, in the format that the name ends in; see `formats.write`.

        Raises:
            BadMapFile, MapTooLarge: If the format is unknown or cannot hold the map, or the file
                cannot be written; a file that was there stays.
        """
        formats.check_written(Path(path))
        formats.write(self.stored(), path)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a map that `save` or OctoMap wrote, or points; see `formats.read`.

        Raises:
            BadMapFile: If it is none.
            BadBox, MapTooLarge, BadSensorModel: If no map of ours can hold it.
        """
        return cls.from_stored(formats.read(path))

    def _build(self, box: Box, sensor: SensorModel) -> None:
        raise NotImplementedError
