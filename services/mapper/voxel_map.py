"""A probabilistic occupancy map of a box: fuse depth images or points, ask, forget, save.

Update rules are OctoMap's (Hornung et al., Autonomous Robots 34, 2013): per scan one update per
voxel, a hit beats a miss, log-odds are clamped, what no ray has told about is unknown, occupied is
p >= 0.5.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.kernels import clamp
from services.mapper import checks
from services.mapper.answers import Fused
from services.mapper.archive import Archive, BehindWindow, Nothing
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.colors import Palette, Uncolored
from services.mapper.errors import BadDecay, BadDepth, BadPoints
from services.mapper.ever_free import EverFreeWatch, Unwatched, Watch
from services.mapper.exact import ExactIntegrator
from services.mapper.fading import Fading
from services.mapper.projective import ProjectiveIntegrator
from services.mapper.published import Published
from services.mapper.sensor_model import SensorModel
from services.mapper.shift import leaving
from services.mapper.storable_map import StorableMap
from services.mapper.view import View

_LONGEST_S = 1e9
"""Of a step of time, 32 years; the clock is a sum of such."""
Pinhole = tuple[float, float, float, float]


class VoxelMap(StorableMap):
    """The map. The box is snapped outward to the voxel lattice and to bricks of 8 voxels.

    The box is a window: `move_to` moves it. What leaves it is forgotten, or, with `archive`, kept
    until it enters again. With `dynamic` the voxels in which something has come are flagged; then
    `changes` ends an instant. `ReadableMap` is what can be asked, `StorableMap` what goes to files.

    Raises:
        BadBox, MapTooLarge, BadSensorModel: All are MapperError; see `box` and `sensor_model`.
    """

    def __init__(
        self,
        resolution_m: float,
        bounds_min_m: Sequence[float],
        bounds_max_m: Sequence[float],
        sensor: SensorModel | None = None,
        *,
        archive: bool = False,
        dynamic: bool = False,
    ) -> None:
        self._behind: BehindWindow = Archive() if archive else Nothing()
        self._build(Box.covering(resolution_m, bounds_min_m, bounds_max_m), sensor or SensorModel())
        if dynamic:
            self._watch = EverFreeWatch(self._store.shape)

    def _build(self, box: Box, sensor: SensorModel) -> None:
        self.box, self.sensor = box, sensor
        self._store = BrickStore(box.num_bricks)
        self._projective = ProjectiveIntegrator(box, self._store, sensor)
        self._exact = ExactIntegrator(box, self._store, sensor)
        self._published = Published(box, self._store)
        self._fading = Fading(self._store)
        self._colors: Palette = Uncolored()
        self._watch: Watch = Unwatched()

    def fuse_depth(
        self,
        depth: NDArray[np.uint16],
        pinhole: Pinhole,
        T_map_camera: ArrayLike,
        depth_scale_m: float = 0.001,
        max_range_m: float = 10.0,
        color: NDArray[np.uint8] | None = None,
    ) -> Fused:
        """Fuse an organised cloud (projective integrator).

        Args:
            depth: (H, W) along the optical axis, times depth_scale_m; 0 tells nothing, 65535 that
                nothing returned: free up to max_range_m.
            pinhole: fx, fy, cx, cy, pixels; integer coordinates are pixel centres.
            T_map_camera: (4, 4) optical frame (x right, y down, z forward) to map frame.
            depth_scale_m: metres per unit.
            max_range_m: depth beyond which nothing is believed; farther returns only free.
            color: (H, W, 3) red, green, blue of every pixel, for `colors`.

        Raises:
            BadDepth, BadColor, BadIntrinsics, BadPose: The map is as it was.
        """
        view = self._checked(depth, pinhole, T_map_camera, depth_scale_m, max_range_m)
        picture = None if color is None else checks.picture(color, view.depth.shape)
        self._colors.forget(self._store.bricks)
        fused = self._projective.fuse([view])
        if picture is not None:
            self._colors = self._colors.with_picture(self._store.bricks, self.box, view, picture)
        return fused

    def fuse_many(self, views: Iterable[View], threads: int = 1) -> Fused:
        """Fuse depth images in order; all are checked before the first is fused.

        With several threads each takes an image; the map is that of one thread to the last bit.
        """
        views = list(views)
        if wrong := [view for view in views if not isinstance(view, View)]:
            raise BadDepth(f"view {wrong[0]!r} must be a View")
        checked = [
            self._checked(v.depth, v.pinhole, v.T_map_camera, v.scale_m, v.max_range_m)
            for v in views
        ]
        self._colors.forget(self._store.bricks)
        return self._projective.fuse(checked, checks.threads(threads))

    def fuse_points(
        self,
        points_m: ArrayLike,
        origin_m: ArrayLike,
        max_range_m: float = math.inf,
        discretize: bool = True,
        threads: int = 1,
    ) -> Fused:
        """Fuse an unorganised cloud (exact integrator): OctoMap's classes, voxel for voxel.

        Rays that leave the box or start outside it are clipped; points that are not finite are
        skipped and counted.

        Args:
            points_m: (N, 3), map frame; taken in single precision as OctoMap does.
            origin_m: (3,) where the rays start, map frame.
            max_range_m: farther points free the ray up to here and hit nothing.
            discretize: one ray per end voxel, to its centre (OctoMap's option of that name).
            threads: rays walk in so many; the map does not depend on it.

        Raises:
            BadPoints: The map is as it was.
        """
        cloud, origin = checks.points(points_m, origin_m)
        if not max_range_m > 0.0:
            raise BadPoints(f"maximum range {max_range_m} m must be positive")
        self._colors.forget(self._store.bricks)
        num_hits, skipped = self._exact.fuse(
            cloud, origin, max_range_m, discretize, checks.threads(threads)
        )
        return Fused(num_hits, len(cloud) - skipped, skipped)

    def changes(self, max_rows: int | None = None) -> NDArray[np.int16]:
        """Return (N, 4) rows i, j, k, class of voxels whose class changed since the last call.

        Indices are in the window as it is now: of what has entered it since, what is known is told.
        More than `max_rows` are not told at once; the rest comes first with the next call.

        Raises:
            BadRows: If they are fewer than a brick's, 512.
        """
        checks.rows_at_once(max_rows)
        self._watch.observe(self._fading.settled(), self.sensor.fixed_point()[2])
        return self._published.changes(self.box, max_rows)

    def move_to(self, centre_m: ArrayLike, slack_bricks: float = 1.0) -> bool:
        """Move the window by whole bricks, to be centred on a point (3,), map frame, m.

        What stays is untouched; what leaves is forgotten, or archived; what enters is unknown, or
        comes back from the archive.

        Args:
            centre_m: the point. slack_bricks: the window stays along the axes on which the point is
                no farther from its centre.

        Returns:
            Whether the window has moved.

        Raises:
            BadBox: If the window would be too far from the origin; the map is as it was.
        """
        step = self.box.step_to(centre_m, slack_bricks)
        if step == (0, 0, 0):
            return False
        box = self.box.moved(step)
        self._fading.present()
        self._behind.receive(self.box, self._store, leaving(self._store.shape, step))
        self._store.shift(step)
        self._watch.shift(step)
        self._colors.forget(self._store.bricks)
        self._behind.hand_back(box, self._store, self.sensor.fixed_point()[2:])
        self.box = box
        self._projective.move_to(box)
        self._exact.move_to(box)
        return True

    def decay(self, dt_s: float, half_life_s: float) -> None:
        """Let time pass, in which log-odds halve every half_life_s.

        What is not seen again becomes unknown. Costs nothing per brick; see `kernels.fade`.

        Raises:
            BadDecay: If dt_s is not in 0 .. 1e9 or half_life_s not positive.
        """
        if not (0.0 <= dt_s <= _LONGEST_S and half_life_s > 0.0):
            raise BadDecay(
                f"dt {dt_s} s must lie in 0 .. {_LONGEST_S:g} s and half-life {half_life_s} s be "
                "positive"
            )
        self._fading.pass_time(dt_s, half_life_s)

    def set_sensor(self, sensor: SensorModel) -> None:
        """Take another sensor model from the next scan on; what is beyond its clamps is clamped."""
        if sensor == self.sensor:
            return
        _, _, low, high = sensor.fixed_point()
        clamp.clamp_all(self._fading.present(), low, high)
        self.sensor = sensor
        self._projective = ProjectiveIntegrator(self.box, self._store, sensor)
        self._exact = ExactIntegrator(self.box, self._store, sensor)

    def clear(self) -> None:
        """Forget everything; costs time per brick of the box, not per voxel."""
        self._store.clear()
        self._watch.clear()
        self._behind.clear()

    @property
    def num_bytes(self) -> int:
        """Bytes held: of bricks, of what was told, of scratch, of the archive."""
        own = self._store.num_bytes + self._published.num_bytes + self._behind.num_bytes
        scratch = self._projective.num_bytes + self._exact.num_bytes
        return own + scratch + self._colors.num_bytes + self._watch.num_bytes

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
