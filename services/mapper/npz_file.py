"""`.npz`: everything that a map knows, in numpy's compressed archive."""

import io
import math
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.kernels.bricks import VOXELS
from services.mapper.box import Box
from services.mapper.errors import BadMapFile, MapperError
from services.mapper.sensor_model import SensorModel
from services.mapper.stored_map import StoredMap, box_of

_FORMAT = "encircle-map-1"
_SMALL = 4096
"""Bytes that suffice for an array's header and for all arrays but those of bricks."""
_DAMAGED = (OSError, EOFError, KeyError, ValueError, MemoryError, RuntimeError, OverflowError)


def npz_bytes(stored: StoredMap) -> bytes:
    """Return the archive."""
    sensor, file = stored.sensor, io.BytesIO()
    arrays: dict[str, NDArray[Any]] = {
        "format": np.array(_FORMAT),
        "resolution_m": np.array(stored.box.resolution_m),
        "first_key": np.array(stored.box.first_key, np.int64),
        "num_bricks": np.array(stored.box.num_bricks, np.int64),
        "sensor": np.array([sensor.hit, sensor.miss, sensor.min, sensor.max]),
        "bricks": stored.bricks,
        "log_odds": stored.log_odds,
    }
    if stored.color is not None:
        arrays["color"] = stored.color
    np.savez_compressed(file, allow_pickle=False, **arrays)
    return file.getvalue()


def read_npz(data: bytes) -> StoredMap:
    """Read what `npz_bytes` returned.

    Raises:
        BadMapFile: If it is damaged or something else.
        BadBox, MapTooLarge, BadSensorModel: If its box or its probabilities are not usable.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            told = str(_array(archive, "format"))
            if told != _FORMAT:
                raise BadMapFile(f"its format is {told[:40]!r}; this version reads {_FORMAT!r}")
            box = _box(archive)
            room = math.prod(box.num_bricks)
            odds = _array(archive, "sensor")
            if odds.shape != (4,):
                raise BadMapFile(f"its sensor model is {odds.tolist()}; it must be 4 numbers")
            names = set(archive.namelist())
            return StoredMap(
                box,
                SensorModel(*(float(value) for value in odds)),
                _array(archive, "bricks", room * 3 * 2),
                _array(archive, "log_odds", room * VOXELS * 2),
                _array(archive, "color", room * VOXELS * 3) if "color.npy" in names else None,
            )
    except MapperError:
        raise
    except (*_DAMAGED, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise BadMapFile(f"no map of ours: {error}") from error


def _array(archive: zipfile.ZipFile, name: str, num_bytes: int = 0) -> NDArray[Any]:
    """Return a member of at most so many bytes: an archive can say much in few."""
    info = archive.getinfo(f"{name}.npy")
    if info.file_size > num_bytes + _SMALL:
        raise BadMapFile(f"{name} has {info.file_size} bytes; its box allows {num_bytes}")
    with archive.open(info) as member:
        array: NDArray[Any] = np.lib.format.read_array(member, allow_pickle=False)
    return array


def _box(archive: zipfile.ZipFile) -> Box:
    resolution_m = float(_array(archive, "resolution_m"))
    first, count = _array(archive, "first_key"), _array(archive, "num_bricks")
    if first.shape != (3,) or count.shape != (3,) or not (count >= 1).all():
        raise BadMapFile(f"a box of {count.tolist()} bricks from voxel {first.tolist()} is none")
    return box_of(resolution_m, first, count)
