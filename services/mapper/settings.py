"""How a mapper service is told what to do."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from services.mapper.box import Box
from services.mapper.fusion import Frames, Memory, MemorySettings
from services.mapper.placement import Follow, Frame, Placement
from services.mapper.report import check_told
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
    follow: Follow = "none"
    """With frame world: what the box moves with, by whole bricks; the map is a rolling window."""
    archive: bool = False
    """Keep what leaves a following box; it is there again when the box is."""
    memory: Memory = "instant"
    """What is kept: all (persistent), this instant only, or what fades (decay)."""
    half_life_s: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """With memory decay: time after which half of the log-odds is gone, s."""
    frames_to_clear: Frames | None = None
    """What has gone is free after so many frames that see through it; instead of miss, clamp_max.
    None: OctoMap's 9."""
    frames_to_appear: Frames | None = None
    """What has come is occupied after so many frames that see it; instead of hit, clamp_min. None:
    OctoMap's 3. What was never seen appears at once."""
    box_min_m: Corner = (-0.6, -0.6, -0.1)
    """Least corner of the box in the map's frame, m; if the box follows, from the target."""
    box_max_m: Corner = (0.6, 0.6, 0.7)
    """Greatest corner of the box, likewise, m."""
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
    """The same when simulated time does not wait, s: at least,"""
    realtime_deadline_max_s: Annotated[float, Field(gt=0, le=60)] = 0.5
    """and at most: in between as long as clouds have lately come after their instant's first."""
    dynamic: bool = False
    """Flag occupied voxels that had been free for long: count them in every summary."""
    color: bool = False
    """Keep the mean color of every voxel, from the pictures on `cams/<i>/color`."""
    files: Path | None = None
    """The only folder in which requests may save and load maps; the working one by default."""
    snapshot: Path | None = None
    """With memory persistent: save the map to this .npz file now and then, and have it again after
    a restart."""
    snapshot_every_s: Annotated[float, Field(gt=0, le=3600)] = 5.0
    """How often the map is saved, s: what a crash may lose."""
    entropy_every: Annotated[int, Field(ge=0)] = 15
    """Compute the map's entropy at every so-manieth instant; 0 never."""

    @model_validator(mode="after")
    def _frames_or_probabilities(self) -> Self:
        for frames, *odds in (
            ("frames_to_clear", "miss", "clamp_max"),
            ("frames_to_appear", "hit", "clamp_min"),
        ):
            for name in odds:
                given = getattr(self, name)
                if (
                    getattr(self, frames) is not None
                    and given != type(self).model_fields[name].default
                ):
                    raise ValueError(
                        f"{frames} {getattr(self, frames)} and {name} {given} exclude each other"
                    )
        return self

    @model_validator(mode="after")
    def _follows_through_the_world(self) -> Self:
        if self.follow == "target" and self.frame == "target":
            raise ValueError(
                "follow target with frame target: there the target stands still; choose frame "
                "world, or follow none"
            )
        if self.archive and self.follow == "none":
            raise ValueError("archive with follow none: nothing leaves a box that stays")
        if self.archive and self.memory == "instant":
            raise ValueError(
                "archive with memory instant: nothing is kept from instant to instant; choose "
                "memory persistent or decay"
            )
        return self

    @model_validator(mode="after")
    def _remembers_what_was_free(self) -> Self:
        if self.dynamic and self.memory == "instant":
            raise ValueError(
                "dynamic with memory instant: nobody remembers what was free; choose memory "
                "persistent or decay"
            )
        return self

    @model_validator(mode="after")
    def _a_snapshot_holds_what_is_kept(self) -> Self:
        if self.snapshot is None:
            return self
        if self.memory != "persistent":
            raise ValueError(
                f"snapshot {self.snapshot} with memory {self.memory}: what is forgotten by itself "
                "is not restored; choose memory persistent"
            )
        if self.follow != "none" or self.color or self.dynamic:
            raise ValueError(
                f"snapshot {self.snapshot} with follow {self.follow}, color {self.color}, dynamic "
                f"{self.dynamic}: it holds a box that stays, its log-odds and no more; choose "
                "follow none, no color, no dynamic"
            )
        if self.snapshot.suffix != ".npz" or not self.snapshot.parent.is_dir():
            raise ValueError(
                f"snapshot {self.snapshot} must end with .npz and lie in a folder that is there"
            )
        return self

    @field_validator("files")
    @classmethod
    def _files_is_a_folder(cls, folder: Path | None) -> Path | None:
        if folder is not None and not folder.is_dir():
            raise ValueError(f"{folder} is no folder")
        return folder

    @model_validator(mode="after")
    def _a_map_can_be_built(self) -> Self:
        self.sensor()
        check_told(Box.covering(self.voxel_size, self.box_min_m, self.box_max_m))
        return self

    def placement(self) -> Placement:
        """Return where the map's frame and its box are."""
        x, y, z = (
            (low + high) / 2 for low, high in zip(self.box_min_m, self.box_max_m, strict=True)
        )
        return Placement(self.frame, self.follow, (x, y, z))

    def sensor(self) -> SensorModel:
        """Return the inverse sensor model where the memory's settings leave it."""
        return SensorModel(self.hit, self.miss, self.clamp_min, self.clamp_max)

    def memory_settings(self) -> MemorySettings:
        """Return what becomes of what was seen."""
        return MemorySettings.model_validate(
            self.model_dump(include={*MemorySettings.model_fields})
        )

    def empty_map(self) -> VoxelMap:
        """Build the map.

        Raises:
            MapperError: If box, voxel size or probabilities are not usable.
        """
        return VoxelMap(
            self.voxel_size,
            self.box_min_m,
            self.box_max_m,
            self.sensor(),
            archive=self.archive,
            dynamic=self.dynamic,
        )
