"""A map on disk for the mapper's next life: there whole, or refused by name and rule."""

import io
import json
import os
import time
import zipfile
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from services.mapper import npz_file, safe_file
from services.mapper.box import Box
from services.mapper.errors import BadMapFile, MapperError
from services.mapper.placement import Frame
from services.mapper.stored_map import StoredMap
from services.mapper.voxel_map import VoxelMap

_ABOUT = "snapshot.json"
_REFUSED = ".refused"


class About(BaseModel):
    """What else a snapshot must say, so that it is not taken for another mapper's."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    frame: Frame
    tick: int = Field(ge=0)


class Restored(NamedTuple):
    """A map that was taken in."""

    tick: int
    """The instant that it was saved after."""
    age_s: float
    """Since it was saved."""


class Snapshot:
    """One file, replaced in one step; `.npz`, which `encircle convert` reads, too."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def save(self, stored: StoredMap, about: About) -> None:
        """Write a map; a crash leaves the file before it.

        Raises:
            BadMapFile: If it cannot be written; the file that was there stays.
        """
        file = io.BytesIO(npz_file.npz_bytes(stored))
        with zipfile.ZipFile(file, "a") as archive:
            archive.writestr(_ABOUT, about.model_dump_json())
        try:
            safe_file.replace(self._path, file.getvalue())
        except OSError as error:
            raise BadMapFile(f"cannot write {self._path}: {error.strerror or error}") from error

    def restore(self, voxel_map: VoxelMap, frame: Frame) -> Restored | None:
        """Let an empty map know what was saved; None if nothing was.

        A snapshot that is damaged, or not of this map, is put aside as `<name>.refused`.

        Raises:
            MapperError: If it is refused; the map is empty.
        """
        self._sweep()
        try:
            data = self._path.read_bytes()
            age_s = max(time.time() - self._path.stat().st_mtime, 0.0)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise BadMapFile(f"cannot read {self._path}: {error.strerror or error}") from error
        try:
            about, stored = _about(data), npz_file.read_npz(data)
            if about.frame != frame:
                raise BadMapFile(f"it is a map of frame {about.frame}; this one is of {frame}")
            if stored.box != voxel_map.box:
                raise BadMapFile(
                    f"its box is {_told(stored.box)}; this map's {_told(voxel_map.box)}"
                )
            voxel_map.take_in(stored)
        except MapperError as error:
            voxel_map.clear()
            aside = self._path.with_name(self._path.name + _REFUSED)
            os.replace(self._path, aside)
            raise type(error)(f"{error}; it is now {aside}") from error
        return Restored(about.tick, age_s)

    def forget(self) -> None:
        """Remove what was saved: it is not to come back."""
        self._path.unlink(missing_ok=True)

    def _sweep(self) -> None:
        """Remove what a crash in the middle of writing left."""
        for part in self._path.parent.glob(f".{self._path.name}.*.part"):
            part.unlink(missing_ok=True)


def _about(data: bytes) -> About:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            info = archive.getinfo(_ABOUT)
            if info.file_size > 4096:
                raise BadMapFile(f"{_ABOUT} has {info.file_size} bytes; at most 4096 are allowed")
            return About.model_validate(json.loads(archive.read(info)))
    except MapperError:
        raise
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, OSError) as error:
        what = "its head is wrong" if isinstance(error, ValidationError) else "no whole snapshot"
        raise BadMapFile(f"{what}: {error}") from error


def _told(box: Box) -> str:
    return f"{box.shape} voxels of {box.resolution_m} m from {box.first_key} on"
