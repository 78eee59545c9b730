"""The mappers that are measured: ours, OctoMap through two bindings, Open3D's block grid."""

import importlib
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.mapping_scenes import Scene
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up

BLOCKS = 20_000
"""Open3D reserves its blocks at once: so many are enough for every scene here."""
Classes = NDArray[np.uint8]


class Rival(Protocol):
    """A mapper that holds a scene's images."""

    def begin(self) -> None:
        """Make an empty map."""

    def fuse(self, n: int) -> object:
        """Fuse the n-th image."""

    def num_bytes(self) -> int:
        """Return what the map says it needs."""

    def classes(self) -> Classes | None:
        """Return the classes of the scene's box, if it knows free space."""


class Ours:
    """Both integrators of this package."""

    def __init__(self, scene: Scene, voxel_m: float, points: bool, discretize: bool) -> None:
        warm_up()
        self._scene, self._voxel_m, self._discretize = scene, voxel_m, discretize
        self._clouds = scene.clouds() if points else None

    def begin(self) -> None:
        self._map = VoxelMap(self._voxel_m, *self._scene.box)

    def fuse(self, n: int) -> object:
        if self._clouds is not None:
            return self._map.fuse_points(*self._clouds[n], discretize=self._discretize)
        view = self._scene.views[n]
        return self._map.fuse_depth(
            view.depth, view.pinhole, view.T_map_camera, view.scale_m, view.max_range_m
        )

    def num_bytes(self) -> int:
        return self._map.num_bytes

    def classes(self) -> Classes | None:
        # Not needed from here on: the tests' reference imports pyoctomap.
        log_odds = self._map.log_odds_dense()
        known = np.where(log_odds >= 0, 2, 1)
        return np.where(np.isnan(log_odds), 0, known).astype(np.uint8)


class OctoMap:
    """OctoMap by a Python binding: the two on PyPI have the same methods."""

    def __init__(self, scene: Scene, voxel_m: float, module: str, discretize: bool) -> None:
        self._module, self._voxel_m = importlib.import_module(module), voxel_m
        self._clouds, self._discretize = scene.clouds(), discretize

    def begin(self) -> None:
        self._tree = self._module.OcTree(self._voxel_m)

    def fuse(self, n: int) -> object:
        cloud, eye = self._clouds[n]
        return self._tree.insertPointCloud(cloud, eye, -1.0, False, self._discretize)

    def num_bytes(self) -> int:
        return int(self._tree.memoryUsage())

    def classes(self) -> Classes | None:
        return None  # Those of the C++ program: the same library, read in a second.


class BlockGrid:
    """Open3D's VoxelBlockGrid: a signed distance in blocks near surfaces; it carves nothing."""

    def __init__(self, scene: Scene, voxel_m: float) -> None:
        from services.evaluator.open3d_loader import open3d

        o3d = open3d()
        self._o3d, self._voxel_m = o3d, voxel_m
        self._tensor = o3d.core.Tensor
        self._inputs = []
        for view in scene.views:
            fx, fy, cx, cy = view.pinhole
            K = self._tensor(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]))
            T = self._tensor(np.linalg.inv(view.T_map_camera))
            image = o3d.t.geometry.Image(self._tensor(view.depth))
            self._inputs.append((image, K, T, 1 / view.scale_m, view.max_range_m))

    def begin(self) -> None:
        kind = self._o3d.core.float32
        self._grid = self._o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight"), (kind, kind), ((1), (1)), self._voxel_m, 8, BLOCKS
        )

    def fuse(self, n: int) -> object:
        image, K, T, scale, range_m = self._inputs[n]
        blocks = self._grid.compute_unique_block_coordinates(image, K, T, scale, range_m)
        return self._grid.integrate(blocks, image, K, T, scale, range_m)

    def num_bytes(self) -> int:
        return int(self._grid.hashmap().size()) * 8**3 * 8

    def classes(self) -> Classes | None:
        return None


RIVALS: dict[str, Callable[[Scene, float], Rival]] = {
    "projective": lambda s, v: Ours(s, v, points=False, discretize=False),
    "exact, discretised": lambda s, v: Ours(s, v, points=True, discretize=True),
    "exact, ray per point": lambda s, v: Ours(s, v, points=True, discretize=False),
    "pyoctomap, discretised": lambda s, v: OctoMap(s, v, "pyoctomap", discretize=True),
    "pyoctomap, ray per point": lambda s, v: OctoMap(s, v, "pyoctomap", discretize=False),
    "octomap-python, discretised": lambda s, v: OctoMap(s, v, "octomap", discretize=True),
    "octomap-python, ray per point": lambda s, v: OctoMap(s, v, "octomap", discretize=False),
    "Open3D VoxelBlockGrid": BlockGrid,
}
ABSENT = {
    "wavemap": "PyPI's package of that name maps audio files; the mapper is source only",
    "Bonxai": "PyPI's package of that name is a notebook widget; the mapper is source only",
    "VDBFusion": "no wheel for this Python",
    "UFOMap, voxblox, supereight2, OHM": "found neither on PyPI nor in Debian",
    "nvblox": "needs a GPU",
    "OpenVDB (python3-openvdb)": "a grid without a mapper: it carves nothing",
    "MRPT (Debian's 2.5)": "its 3D occupancy map is OctoMap; the voxel map came with 2.11",
}
"""What was looked for and cannot be measured here, with the reason."""
