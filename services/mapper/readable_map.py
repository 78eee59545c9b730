"""What can be asked of a map."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels import classes
from services.kernels.bricks import UNKNOWN
from services.mapper import checks
from services.mapper.answers import Counts, Voxels
from services.mapper.archive import BehindWindow, Block
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.colors import Palette, Uncolored
from services.mapper.entropy import entropy_bits, entropy_bits_of
from services.mapper.ever_free import Watch
from services.mapper.fading import Fading
from services.mapper.listing import voxels_of
from services.mapper.map_questions import MapQuestions
from services.mapper.published import Published, Snapshot
from services.mapper.questions import Bounds, log_odds_of, part_of
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.stored_map import UNCOLORED


class ReadableMap(MapQuestions):
    """The questions of a VoxelMap; what it holds is built there.

    `classify`, `occupied` and `free` know the window and the archive, all else is about the window.
    """

    box: Box
    """The window."""
    sensor: SensorModel
    _store: BrickStore
    _behind: BehindWindow
    _fading: Fading
    _published: Published
    _colors: Palette
    _watch: Watch

    def classify(self, points_m: ArrayLike) -> NDArray[np.uint8]:
        """Return for points (N, 3), map frame: 0 unknown, 1 free, 2 occupied.

        Outside the window it is what the archive holds, or unknown.
        """
        points = checks.rows_of_three(points_m)
        out, keys = np.empty(len(points), np.uint8), self.box.keys(points)
        classes.classify_points(self._fading.settled(), keys, out)
        outside = ((keys < 0) | (keys >= self.box.shape)).any(axis=1)
        out[outside] = self._behind.classify(self.box, keys[outside])
        return out

    def occupied(self) -> Voxels:
        """Return the occupied voxels, of the window and the archive."""
        return voxels_of(self._blocks(), self.box, occupied=True)

    @property
    def is_colored(self) -> bool:
        """Whether a picture was ever fused."""
        return not isinstance(self._colors, Uncolored)

    def colors(self) -> NDArray[np.uint8]:
        """Return (N, 3) red, green, blue of the voxels of `occupied`, in its order.

        The mean of the pixels that returned from there; white (255, 255, 255) where there was none:
        seen without a picture, come from the archive, or loaded with a brick that was uniform.
        """
        window = self._colors.of_known(self._fading.present())
        parts = []
        for n, (_, log_odds) in enumerate(self._blocks()):
            color = np.full((*log_odds.shape, 3), UNCOLORED, np.uint8) if n else window
            parts.append(color[log_odds >= 0])
        return np.concatenate(parts)

    def dynamic(self) -> Voxels:
        """Return the occupied voxels of the window that had been free for long; see `ever_free`.

        They are those of the last `changes` that are occupied still; none if the map was not made
        with `dynamic`.
        """
        self._fading.present()
        voxels = self._watch.dynamic()
        log_odds = self._store.log_odds_at(voxels)
        voxels, log_odds = voxels[log_odds >= 0], log_odds[log_odds >= 0]
        probability = 1 / (1 + np.exp(-log_odds.astype(np.float64) / LOG_ODDS_SCALE))
        return Voxels(self.box.centres_m(voxels), probability)

    @property
    def num_dynamic(self) -> int:
        """How many voxels `dynamic` returns."""
        if self._watch.num_dynamic == 0:
            return 0
        self._fading.settled()
        return int((self._store.log_odds_at(self._watch.dynamic()) >= 0).sum())

    def free(self) -> Voxels:
        """Return the free voxels, of the window and the archive."""
        return voxels_of(self._blocks(), self.box, occupied=False)

    def log_odds_dense(self) -> NDArray[np.float32]:
        """Return the log-odds of the whole box, (nx, ny, nz); unknown is NaN."""
        dense = np.empty(self.box.shape, np.int16)
        classes.expand(self._fading.present(), dense)
        unit = np.float32(1 / LOG_ODDS_SCALE)
        return np.where(dense == UNKNOWN, np.float32(np.nan), dense.astype(np.float32) * unit)

    def counts(self) -> Counts:
        """Return the number of voxels of each class."""
        free, occupied = classes.count_classes(self._fading.settled())
        return Counts(self.box.num_voxels - free - occupied, int(free), int(occupied))

    def entropy_bits(self, bounds_m: Bounds | None = None) -> float:
        """Return the sum of the voxels' Shannon entropies; an unknown voxel has one bit.

        Args:
            bounds_m: least and greatest corner, map frame, of the part asked about; None is all.

        Raises:
            BadBox, TooMuchAsked: See `unknown`.
        """
        if bounds_m is None:
            return entropy_bits(self._fading.present())
        part = part_of(self.box, bounds_m)
        return entropy_bits_of(log_odds_of(self._fading.present(), part))

    def known_bricks(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return (M, 3) indices and (M, 512) log-odds (1/8192; -32768 unknown) of known bricks.

        Of the window; not the archive.
        """
        self._fading.present()
        return self._store.known()

    def snapshot(self) -> Snapshot:
        """Return the window's known bricks with the classes, and the box, of the last `changes`."""
        self._fading.present()
        return self._published.snapshot(self.box, self.sensor)

    @property
    def num_open(self) -> int:
        """Bricks of the window whose voxels differ, and that therefore take memory."""
        return self._store.num_open

    @property
    def num_archived(self) -> int:
        """Bricks in the archive."""
        return self._behind.num_bricks

    def _blocks(self) -> Iterator[Block]:
        yield self.known_bricks()
        yield from self._behind.blocks(self.box)
