"""Maps on disk: `.npz`, everything the map knows, and `.ply`, its occupied voxels as points."""

import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.box import Box
from services.mapper.errors import BadMapFile
from services.mapper.sensor_model import SensorModel

_FORMAT = "encircle-map-1"


class StoredMap(NamedTuple):
    """What a `.npz` holds."""

    box: Box
    sensor: SensorModel
    bricks: NDArray[np.int16]
    """(M, 3) indices."""
    log_odds: NDArray[np.int16]
    """(M, 512) in 1/8192; -32768 is unknown."""


def write_npz(path: Path, stored: StoredMap) -> None:
    """Write a map with numpy's compressed archive."""
    sensor = stored.sensor
    np.savez_compressed(
        path,
        format=np.array(_FORMAT),
        resolution_m=np.float64(stored.box.resolution_m),
        first_key=np.asarray(stored.box.first_key, np.int64),
        num_bricks=np.asarray(stored.box.num_bricks, np.int64),
        sensor=np.array([sensor.hit, sensor.miss, sensor.min, sensor.max]),
        bricks=stored.bricks,
        log_odds=stored.log_odds,
    )


def read_npz(path: Path) -> StoredMap:
    """Read what `write_npz` wrote.

    Raises:
        BadMapFile: If the file is missing, damaged or holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            if str(archive["format"]) != _FORMAT:
                raise BadMapFile(f"{path} is {archive['format']!s}; this version reads {_FORMAT}")
            i, j, k = (int(value) for value in archive["first_key"])
            bx, by, bz = (int(value) for value in archive["num_bricks"])
            stored = StoredMap(
                Box(float(archive["resolution_m"]), (i, j, k), (bx, by, bz)),
                SensorModel(*(float(value) for value in archive["sensor"])),
                archive["bricks"],
                archive["log_odds"],
            )
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise BadMapFile(f"{path} is no map of ours: {error}") from error
    rows = len(stored.bricks)
    inside = stored.bricks.shape == (rows, 3) and stored.log_odds.shape == (rows, 512)
    if not inside or (stored.bricks < 0).any() or (stored.bricks >= stored.box.num_bricks).any():
        raise BadMapFile(f"{path}: bricks {stored.bricks.shape} do not lie in {stored.box}")
    return stored


def write_ply(path: Path, points_m: NDArray[np.float64], probability: NDArray[np.float64]) -> None:
    """Write points (N, 3) and their probability as binary little-endian PLY vertices."""
    fields = [(name, "<f4") for name in ("x", "y", "z", "probability")]
    vertices = np.empty(len(points_m), fields)
    vertices["x"], vertices["y"], vertices["z"] = points_m.T
    vertices["probability"] = probability
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment encircle: centres of occupied voxels, metres",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name, _ in fields),
        "end_header",
    ]
    path.write_bytes("\n".join([*header, ""]).encode() + vertices.tobytes())
