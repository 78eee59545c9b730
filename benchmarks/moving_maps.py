"""The maps that are compared: OctoMap, and ours with the memories that a user can choose."""

import time
from typing import Protocol

import numpy as np
from moving_scene import BOUNDS, RATE_HZ, Instant, points_of
from numpy.typing import NDArray
from pyoctomap import OcTree

from services.kernels.rigid import FloatArray
from services.mapper.sensor_model import SensorModel
from services.mapper.voxel_map import VoxelMap

OCTOMAP_FRAMES = 9
"""Misses from OctoMap's upper clamp to free."""


class Contender(Protocol):
    """A map under test."""

    name: str
    frames_to_clear: int
    num_images: int
    cpu_s: float

    def fuse(self, instant: Instant) -> None:
        """Fuse every camera's cloud of an instant."""

    def occupied(self, centres_m: FloatArray) -> NDArray[np.bool_]:
        """Return (N,) which voxels are occupied."""


class OctoMap:
    """`insertPointCloud` with OctoMap's model, discretised or a ray per point."""

    name = "OctoMap"
    frames_to_clear = OCTOMAP_FRAMES

    def __init__(self, voxel_m: float, *, discretize: bool) -> None:
        self._tree, self._discretize = OcTree(voxel_m), discretize
        self.num_images, self.cpu_s = 0, 0.0

    def fuse(self, instant: Instant) -> None:
        """Insert point clouds; a pixel without return cannot be told."""
        clouds = [(points_of(view), view.T_map_camera[:3, 3].copy()) for view in instant.views]
        began_s = time.process_time()
        for cloud, eye in clouds:
            self._tree.insertPointCloud(cloud, eye, discretize=self._discretize)
        self.cpu_s += time.process_time() - began_s
        self.num_images += len(clouds)

    def occupied(self, centres_m: FloatArray) -> NDArray[np.bool_]:
        """Ask the tree."""
        labels: NDArray[np.bool_] = np.asarray(self._tree.getLabels(centres_m)) == 1
        return labels


class Ours:
    """A `VoxelMap`; `memory` as the mapper's setting, half_life_s with decay."""

    def __init__(
        self,
        name: str,
        voxel_m: float,
        sensor: SensorModel | None = None,
        *,
        frames_to_clear: int = OCTOMAP_FRAMES,
        half_life_s: float | None = None,
        instant: bool = False,
    ) -> None:
        self.name, self.frames_to_clear = name, frames_to_clear
        self._map = VoxelMap(voxel_m, *BOUNDS, sensor)
        self._half_life_s, self._instant = half_life_s, instant
        self.num_images, self.cpu_s = 0, 0.0

    def fuse(self, instant: Instant) -> None:
        """Forget as the memory says, then fuse depth images."""
        began_s = time.process_time()
        if self._instant:
            self._map.clear()
        if self._half_life_s is not None:
            self._map.decay(1 / RATE_HZ, self._half_life_s)
        self._map.fuse_many(instant.views)
        self._map.changes()
        self.cpu_s += time.process_time() - began_s
        self.num_images += len(instant.views)

    def occupied(self, centres_m: FloatArray) -> NDArray[np.bool_]:
        """Ask the map."""
        occupied: NDArray[np.bool_] = self._map.classify(centres_m) == 2
        return occupied


def contenders(voxel_m: float, frames: tuple[int, ...], *, rays: bool) -> list[Contender]:
    """Return the maps that are compared; OctoMap casts a ray per point, or per voxel."""
    maps: list[Contender] = [OctoMap(voxel_m, discretize=not rays)]
    maps.append(Ours("ours, OctoMap's model", voxel_m))
    for k in frames:
        model = SensorModel.from_frames(k, 1)
        maps.append(Ours(f"ours, clear {k}, appear 1", voxel_m, model, frames_to_clear=k))
    two = SensorModel.from_frames(2)
    maps.append(Ours("ours, clear 2", voxel_m, two, frames_to_clear=2))
    maps.append(Ours("ours, decay 0.5 s", voxel_m, half_life_s=0.5))
    maps.append(Ours("ours, instant", voxel_m, frames_to_clear=1, instant=True))
    return maps
