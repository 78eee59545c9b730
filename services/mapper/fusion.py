"""One instant after the other: clouds in the world become a map of the box."""

import time
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from schemas.cloud import Cloud, DepthCloud
from services.kernels.rigid import apply, inverse
from services.mapper.sensor_model import MOST_FRAMES, SensorModel
from services.mapper.voxel_map import VoxelMap

Memory = Literal["persistent", "instant", "decay"]
Frames = Annotated[int, Field(ge=1, le=MOST_FRAMES)]


class MemorySettings(BaseModel):
    """What becomes of what was seen before."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    memory: Memory = "instant"
    half_life_s: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    frames_to_clear: Frames | None = None
    """Misses that free a voxel however often it was hit; None: as the sensor model says."""
    frames_to_appear: Frames | None = None
    """Hits that fill a voxel however long it was free; None: as the sensor model says."""

    def sensor(self, base: SensorModel) -> SensorModel:
        """Return a sensor model with our numbers of frames."""
        return base.with_frames(self.frames_to_clear, self.frames_to_appear)


class Fusion:
    """The map, the instant at hand, and the map frame's pose in it.

    Another `memory` counts from the next instant on.

    `instant` knows this instant's clouds alone, `decay` forgets by half-life, `persistent` is
    OctoMap: never.
    """

    def __init__(self, voxel_map: VoxelMap, memory: MemorySettings) -> None:
        self.voxel_map, self.memory = voxel_map, memory
        self._base = voxel_map.sensor
        """The sensor model where the memory's settings say nothing."""
        self.T_world_map: NDArray[np.float64] = np.eye(4)
        self.num_returns, self.fuse_s = 0, 0.0
        self.used: tuple[int, ...] = ()
        self._t_ns: int | None = None

    def begin(
        self,
        t_ns: int,
        T_world_map: NDArray[np.float64],
        centre_m: NDArray[np.float64] | None = None,
    ) -> None:
        """Begin an instant, with the map frame where it is then.

        Args:
            t_ns: its time. T_world_map: (4, 4).
            centre_m: (3,) what the box is to be about, map frame; None: it stays.

        Raises:
            BadBox: If the box cannot move there; it stays, the instant has begun.
        """
        began_s = time.perf_counter()
        self.voxel_map.set_sensor(self.memory.sensor(self._base))
        dt_s = 0.0 if self._t_ns is None else max(t_ns - self._t_ns, 0) * 1e-9
        match self.memory.memory:
            case "instant":
                self.voxel_map.clear()
            case "decay":
                self.voxel_map.decay(dt_s, self.memory.half_life_s)
            case "persistent":
                pass
        self._t_ns, self.T_world_map = t_ns, T_world_map
        self.num_returns, self.used = 0, ()
        if centre_m is not None:
            self.voxel_map.move_to(centre_m)
        self.fuse_s = time.perf_counter() - began_s

    def fuse(self, cloud: Cloud, picture: NDArray[np.uint8] | None = None) -> None:
        """Fuse one cloud of the instant, and the picture (H, W, 3) of its pixels.

        Raises:
            MapperError: The map is as it was.
        """
        began_s = time.perf_counter()
        T_map_camera = inverse(self.T_world_map) @ cloud.pose.matrix()
        if isinstance(cloud, DepthCloud):
            k = cloud.intrinsics
            fused = self.voxel_map.fuse_depth(
                cloud.array,
                (k.fx, k.fy, k.cx, k.cy),
                T_map_camera,
                cloud.depth_scale_m,
                cloud.max_range_m,
                picture,
            )
            self.num_returns += fused.num_returns
        else:
            fused = self.voxel_map.fuse_points(
                apply(T_map_camera, cloud.array), T_map_camera[:3, 3], cloud.max_range_m
            )
            self.num_returns += fused.num_returns
        self.used = (*self.used, cloud.camera)
        self.fuse_s += time.perf_counter() - began_s
