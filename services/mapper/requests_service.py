"""What a mapper is asked on the bus: `ctl/mapper/<verb>`.

All but `get` are carried out between instants, so that nobody sees, saves or clears half of one.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from schemas.cloud import Cloud
from services.mapper import formats
from services.mapper.barrier import Barrier
from services.mapper.errors import BadMemory
from services.mapper.fusion import Fusion, MemorySettings
from services.mapper.inquiry import Inquiry
from services.mapper.map_folder import MapFolder
from services.mapper.pictures import Album
from services.mapper.report import Reporter, check_told
from services.mapper.requests import (
    CastRays,
    Classify,
    Distance,
    Entropy,
    Get,
    Load,
    Request,
    Reset,
    Save,
)
from services.mapper.settings import MapperSettings
from services.mapper.voxel_map import VoxelMap
from services.runtime.command import only
from services.runtime.loop import Gate, Loop

Params = dict[str, Any]
R = TypeVar("R", bound=Request)


class Requests:
    """Serves every verb; a wrong request is refused and counted, and changes nothing."""

    def __init__(
        self,
        settings: MapperSettings,
        fusion: Fusion,
        reporter: Reporter,
        barrier: Barrier[Cloud],
        pictures: Album,
        forget_snapshot: Callable[[], None],
    ) -> None:
        self._settings, self._fusion, self._reporter = settings, fusion, reporter
        self._barrier, self._pictures = barrier, pictures
        self._forget_snapshot = forget_snapshot
        self._inquiry = Inquiry(fusion)
        self._folder = MapFolder(settings.files or Path.cwd())

    def serve(self, loop: Loop, between_instants: Gate) -> None:
        """Answer from now on."""
        loop.serve("get", self._get)
        loop.serve("set", self._set, between_instants)
        inquiry = self._inquiry
        handlers = {
            "reset": self._handler(Reset, self._reset),
            "classify": self._handler(Classify, inquiry.classify),
            "cast_rays": self._handler(CastRays, inquiry.cast_rays),
            "distance": self._handler(Distance, inquiry.distance),
            "entropy": self._handler(Entropy, inquiry.entropy),
            "save": self._handler(Save, self._save),
            "load": self._handler(Load, self._load),
        }
        for verb, handler in handlers.items():
            loop.serve(verb, handler, between_instants)

    def _handler(
        self, kind: type[R], carry_out: Callable[[R], Params]
    ) -> Callable[[Params], Params]:
        def handle(params: Params) -> Params:
            answer = carry_out(_parsed(kind, params))
            return {"rev": self._reporter.rev, "tick": self._reporter.tick, **answer}

        return handle

    def _get(self, params: Params) -> Params:
        """Return what the map is and holds, also in the middle of an instant."""
        _parsed(Get, params)
        voxel_map, memory = self._fusion.voxel_map, self._fusion.memory
        return {
            "rev": self._reporter.rev,
            "tick": self._reporter.tick,
            "cameras": list(self._barrier.alive),
            "frame": self._settings.frame,
            "follow": self._settings.follow,
            "archived_bricks": voxel_map.num_archived,
            "num_dynamic": voxel_map.num_dynamic,
            "voxel_size": voxel_map.box.resolution_m,
            "origin_m": voxel_map.box.origin_m.tolist(),
            "shape": list(voxel_map.box.shape),
            "entropy_bits": voxel_map.entropy_bits(),
            "num_bytes": voxel_map.num_bytes,
            "is_colored": voxel_map.is_colored,
            "clouds_without_picture": self._pictures.num_missing,
            **memory.model_dump(),
            **voxel_map.counts()._asdict(),
        }

    def _set(self, params: Params) -> Params:
        """Change what is remembered and how fast, from the next instant on."""
        only(params, *MemorySettings.model_fields)
        merged = {**self._fusion.memory.model_dump(), **params}
        self._fusion.memory = MemorySettings.model_validate(merged)
        return self._get({})

    def _reset(self, _: Reset) -> Params:
        """Forget the map; the next changes tell."""
        self._forget_snapshot()
        self._fusion.voxel_map.clear()
        return self._get({})

    def _save(self, asked: Save) -> Params:
        """Write the map as the last instant left it."""
        path = self._folder.to_write(asked.path)
        self._fusion.voxel_map.save(path)
        return {"path": str(path), **self._fusion.voxel_map.counts()._asdict()}

    def _load(self, asked: Load) -> Params:
        """Go on with a map from a file; the next changes tell all that the box holds of it.

        The box is that of the file, unless it follows something: then it stays where it is, and the
        rest of the file goes to the archive.
        """
        if self._fusion.memory.memory == "instant":
            raise BadMemory(
                "memory 'instant' forgets a loaded map with the next instant; "
                "set memory to 'persistent' or 'decay' first"
            )
        path = self._folder.to_read(asked.path)
        self._forget_snapshot()
        if self._settings.follow == "none":
            loaded = VoxelMap.load(path)
            check_told(loaded.box)
            self._fusion.voxel_map = loaded
            self._reporter.begin_anew()
        else:
            self._fusion.voxel_map.take_in(formats.read(path))
        return {**self._get({}), "path": str(path)}


def _parsed(kind: type[R], params: Params) -> R:
    only(params, *kind.model_fields)
    return kind.model_validate(params)
