"""A probabilistic occupancy map of a box: fuse depth images or points, ask, forget, save.

Update rules are OctoMap's (Hornung et al., Autonomous Robots 34, 2013): per scan one update per
voxel, a hit beats a miss, log-odds are clamped, what no ray has told about is unknown, occupied is
p >= 0.5.
"""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels import classes
from services.kernels.bricks import UNKNOWN
from services.mapper import checks, map_files
from services.mapper.answers import Counts, Fused, Voxels
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.errors import BadDecay, BadMapFile, BadPoints
from services.mapper.exact import ExactIntegrator
from services.mapper.projective import ProjectiveIntegrator, View
from services.mapper.published import Published
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel

FORGOTTEN = LOG_ODDS_SCALE // 10
"""Log-odds (fixed point) below which decay makes a voxel unknown: |p - 0.5| < 0.025."""
_ENTROPY_SHIFT = 4  # a table of 4096 entries stays in the first cache; the error is below 1e-3 bit.
Pinhole = tuple[float, float, float, float]


class VoxelMap:
    """The map. The box is snapped outward to the voxel lattice and to bricks of 8 voxels.

    Raises:
        BadBox, MapTooLarge, BadSensorModel: All are MapperError; see `box` and `sensor_model`.
    """

    def __init__(
        self,
        resolution_m: float,
        bounds_min_m: Sequence[float],
        bounds_max_m: Sequence[float],
        sensor: SensorModel | None = None,
    ) -> None:
        self._build(Box.covering(resolution_m, bounds_min_m, bounds_max_m), sensor or SensorModel())

    def _build(self, box: Box, sensor: SensorModel) -> None:
        self.box, self.sensor = box, sensor
        self._store = BrickStore(box.num_bricks)
        self._projective = ProjectiveIntegrator(box, self._store, sensor)
        self._exact = ExactIntegrator(box, self._store, sensor)
        self._published = Published(self._store)
        levels = (np.arange(0, 65536, 1 << _ENTROPY_SHIFT) + UNKNOWN) / LOG_ODDS_SCALE
        p = 1.0 / (1.0 + np.exp(-levels))
        self._bits = (-p * np.log2(p) - (1 - p) * np.log2(1 - p)).astype(np.float32)
        self._bits[0] = 1.0  # unknown.

    def fuse_depth(
        self,
        depth: NDArray[np.uint16],
        pinhole: Pinhole,
        T_map_camera: ArrayLike,
        depth_scale_m: float = 0.001,
        max_range_m: float = 10.0,
    ) -> Fused:
        """Fuse an organised cloud (projective integrator).

        Args:
            depth: (H, W) along the optical axis, times depth_scale_m; 0 tells nothing, 65535 that
                nothing returned: free up to max_range_m.
            pinhole: fx, fy, cx, cy, pixels; integer coordinates are pixel centres.
            T_map_camera: (4, 4) optical frame (x right, y down, z forward) to map frame.
            depth_scale_m: metres per unit.
            max_range_m: depth beyond which nothing is believed; farther returns only free.

        Raises:
            BadDepth, BadIntrinsics, BadPose: The map is as it was.
        """
        view = self._checked(depth, pinhole, T_map_camera, depth_scale_m, max_range_m)
        return self._projective.fuse(view)

    def fuse_many(self, views: Iterable[View]) -> Fused:
        """Fuse depth images in order; all are checked before the first is fused."""
        checked = [
            self._checked(v.depth, v.pinhole, v.T_map_camera, v.scale_m, v.max_range_m)
            for v in views
        ]
        fused = [self._projective.fuse(view) for view in checked]
        return Fused(sum(f.num_hits for f in fused), sum(f.num_returns for f in fused), 0)

    def fuse_points(
        self,
        points_m: ArrayLike,
        origin_m: ArrayLike,
        max_range_m: float = math.inf,
        discretize: bool = True,
    ) -> Fused:
        """Fuse an unorganised cloud (exact integrator): OctoMap's classes, voxel for voxel.

        Rays that leave the box or start outside it are clipped; points that are not finite are
        skipped and counted.

        Args:
            points_m: (N, 3), map frame; taken in single precision as OctoMap does.
            origin_m: (3,) where the rays start, map frame.
            max_range_m: farther points free the ray up to here and hit nothing.
            discretize: one ray per end voxel, to its centre (OctoMap's option of that name).

        Raises:
            BadPoints: The map is as it was.
        """
        cloud, origin = checks.points(points_m, origin_m)
        if not max_range_m > 0.0:
            raise BadPoints(f"maximum range {max_range_m} m must be positive")
        num_hits, skipped = self._exact.fuse(cloud, origin, max_range_m, discretize)
        return Fused(num_hits, len(cloud) - skipped, skipped)

    def classify(self, points_m: ArrayLike) -> NDArray[np.uint8]:
        """Return for points (N, 3), map frame: 0 unknown or outside, 1 free, 2 occupied."""
        points = np.asarray(points_m, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise BadPoints(f"points have shape {points.shape}; it must be (N, 3)")
        out = np.empty(len(points), np.uint8)
        classes.classify_points(self._store.bricks, self.box.keys(points), out)
        return out

    def occupied(self) -> Voxels:
        """Return the occupied voxels."""
        return self._voxels(occupied=True)

    def free(self) -> Voxels:
        """Return the free voxels."""
        return self._voxels(occupied=False)

    def log_odds_dense(self) -> NDArray[np.float32]:
        """Return the log-odds of the whole box, (nx, ny, nz); unknown is NaN."""
        dense = np.empty(self.box.shape, np.int16)
        classes.expand(self._store.bricks, dense)
        unit = np.float32(1 / LOG_ODDS_SCALE)
        return np.where(dense == UNKNOWN, np.float32(np.nan), dense.astype(np.float32) * unit)

    def changes(self) -> NDArray[np.int16]:
        """Return (N, 4) rows i, j, k, class of voxels whose class changed since the last call."""
        return self._published.changes()

    def decay(self, dt_s: float, half_life_s: float) -> None:
        """Halve the log-odds every half_life_s: what is not seen again becomes unknown.

        Raises:
            BadDecay: If dt_s is negative or half_life_s not positive.
        """
        if not (math.isfinite(dt_s) and dt_s >= 0.0 and half_life_s > 0.0):
            raise BadDecay(f"dt {dt_s} s must be >= 0 and half-life {half_life_s} s positive")
        factor = np.float32(0.5 ** (dt_s / half_life_s))
        classes.fade_bricks(self._store.bricks, factor, FORGOTTEN)

    def clear(self) -> None:
        """Forget everything; costs time per brick of the box, not per voxel."""
        self._store.clear()

    def counts(self) -> Counts:
        """Return the number of voxels of each class."""
        free, occupied = classes.count_classes(self._store.bricks)
        return Counts(self.box.num_voxels - free - occupied, int(free), int(occupied))

    def entropy_bits(self) -> float:
        """Return the sum of the voxels' Shannon entropies; an unknown voxel has one bit."""
        return float(classes.sum_entropy(self._store.bricks, self._bits, _ENTROPY_SHIFT))

    def known_bricks(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return (M, 3) indices and (M, 512) log-odds (1/8192; -32768 unknown) of known bricks."""
        return self._store.known()

    def published_bricks(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return known bricks as `known_bricks` does, with the classes of the last `changes`."""
        return self._published.bricks(self.sensor)

    @property
    def num_bytes(self) -> int:
        """Bytes held for bricks: the directory and the pool."""
        return self._store.num_bytes

    def save(self, path: str | Path) -> None:
        """Write `.npz` (all that is known; `load` reads it) or `.ply` (occupied voxels).

        Raises:
            BadMapFile: If the name ends otherwise or the file cannot be written.
        """
        path = Path(path)
        try:
            match path.suffix:
                case ".npz":
                    stored = map_files.StoredMap(self.box, self.sensor, *self.known_bricks())
                    map_files.write_npz(path, stored)
                case ".ply":
                    map_files.write_ply(path, *self.occupied())
                case suffix:
                    raise BadMapFile(f"unknown format {suffix!r} of {path}; known: .npz, .ply")
        except OSError as error:
            raise BadMapFile(f"cannot write {path}: {error}") from error

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a map that `save` wrote as `.npz`.

        Raises:
            BadMapFile: If it is none.
        """
        stored = map_files.read_npz(Path(path))
        loaded = cls.__new__(cls)
        loaded._build(stored.box, stored.sensor)
        loaded._store.restore(stored.bricks, stored.log_odds)
        return loaded

    def _checked(
        self,
        depth: NDArray[np.uint16],
        pinhole: Pinhole,
        T_map_camera: ArrayLike,
        scale_m: float,
        max_range_m: float,
    ) -> View:
        image = checks.depth_image(depth, scale_m, max_range_m)
        pose, camera = checks.rigid(T_map_camera), checks.pinhole(pinhole)
        return View(image, camera, pose, scale_m, max_range_m)

    def _voxels(self, occupied: bool) -> Voxels:
        index, log_odds = self.known_bricks()
        chosen = (log_odds != UNKNOWN) & ((log_odds >= 0) == occupied)
        rows, local = np.nonzero(chosen)
        inside = np.stack([local >> 6, (local >> 3) & 7, local & 7], axis=1)
        voxels = index[rows].astype(np.int64) * 8 + inside
        probability = 1.0 / (1.0 + np.exp(-log_odds[rows, local] / LOG_ODDS_SCALE))
        return Voxels(self.box.centres_m(voxels), probability)
