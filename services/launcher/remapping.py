"""Recorded instants into a map, by the mapper's own core."""

import numpy as np

from schemas.map import MapChanges
from services.launcher.instants import Instant
from services.mapper.errors import MapperError
from services.mapper.fusion import Fusion
from services.mapper.report import Reporter
from services.mapper.settings import MapperSettings


class Remapping:
    """Does with an instant what the mapper does when its clouds have come."""

    def __init__(self, settings: MapperSettings) -> None:
        self.fusion = Fusion(settings.empty_map(), settings.memory_settings())
        self._placement = settings.placement()
        self._reporter = Reporter(self.fusion, settings.frame, 0)
        self.num_clouds = self.num_instants = 0
        self.num_homeless = 0
        """Instants that the target's frame needs a pose for, and none was recorded."""
        self.refused: list[str] = []

    def fuse(self, instant: Instant) -> MapChanges | None:
        """Fuse an instant; return what changed, None if it cannot be placed."""
        T_world_target = instant.T_world_target
        if T_world_target is None:
            if self._placement.needs_target:
                self.num_homeless += 1
                return None
            T_world_target = np.eye(4)
        T_world_map = self._placement.T_world_map(T_world_target)
        centre_m = self._placement.centre_m(T_world_target)
        try:
            self.fusion.begin(instant.t_ns, T_world_map, centre_m)
        except MapperError as error:
            self.refused.append(f"tick {instant.tick}: {error}")
        for cloud in instant.clouds:
            try:
                self.fusion.fuse(cloud)
                self.num_clouds += 1
            except MapperError as error:
                self.refused.append(f"tick {instant.tick}, camera {cloud.camera}: {error}")
        self.num_instants += 1
        return self._reporter.changes(instant.tick, instant.t_ns)
