"""How a mapper service is told what to do."""

from typing import Annotated

from pydantic import Field

from services.mapper.fusion import Frame, Memory, MemorySettings
from services.mapper.sensor_model import SensorModel
from services.mapper.voxel_map import VoxelMap
from services.runtime.settings import ServiceSettings

Probability = Annotated[float, Field(gt=0, lt=1)]
Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
Corner = tuple[Metres, Metres, Metres]


class MapperSettings(ServiceSettings):
    """Fuse the clouds of all cameras, instant by instant, into one map."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_MAPPER_"}

    voxel_size: Annotated[float, Field(gt=0, le=10)] = 0.01
    """Edge of a voxel, m."""
    frame: Frame = "target"
    """What the map's box is fixed to."""
    memory: Memory = "instant"
    """What is kept: all (persistent), this instant only, or what fades (decay)."""
    half_life_s: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """With memory decay: time after which half of the log-odds is gone, s."""
    box_min_m: Corner = (-0.6, -0.6, -0.1)
    """Least corner of the box in the map's frame, m."""
    box_max_m: Corner = (0.6, 0.6, 0.7)
    """Greatest corner of the box in the map's frame, m."""
    hit: Probability = 0.7
    """Occupancy that one return speaks for (OctoMap)."""
    miss: Probability = 0.4
    """Occupancy that one ray passing speaks for (OctoMap)."""
    clamp_min: Probability = 0.1192
    """Least occupancy a voxel can reach (OctoMap)."""
    clamp_max: Probability = 0.971
    """Greatest occupancy a voxel can reach (OctoMap)."""
    deadline_s: Annotated[float, Field(gt=0, le=60)] = 1.5
    """In lockstep, and without a simulator: how long an instant waits for its cameras, s."""
    realtime_deadline_s: Annotated[float, Field(gt=0, le=60)] = 0.1
    """The same when simulated time does not wait, s."""
    entropy_every: Annotated[int, Field(ge=0)] = 15
    """Compute the map's entropy at every so-manieth instant; 0 never."""

    def sensor(self) -> SensorModel:
        """Return the inverse sensor model."""
        return SensorModel(self.hit, self.miss, self.clamp_min, self.clamp_max)

    def memory_settings(self) -> MemorySettings:
        """Return what becomes of what was seen."""
        return MemorySettings(memory=self.memory, half_life_s=self.half_life_s)

    def empty_map(self) -> VoxelMap:
        """Build the map.

        Raises:
            MapperError: If box, voxel size or probabilities are not usable.
        """
        return VoxelMap(self.voxel_size, self.box_min_m, self.box_max_m, self.sensor())
