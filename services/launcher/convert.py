"""`encircle convert`: a map from one format into another."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from services.launcher.errors import LauncherError, SettingsError
from services.mapper import formats
from services.mapper.errors import MapperError
from services.mapper.stored_map import num_known

_ABOUT = """\
Read a map and write it in another format; the names' endings tell which.

  .npz        everything that a map knows                           read, written
  .ot         OctoMap's octree: log-odds of every node, color       read, written
  .bt         OctoMap's octree: free and occupied                   read, written
  .ply        centres of occupied voxels, probability, color        read, written
  .obj .glb   the surface as triangles; .ply, too, with --mesh            written"""


def convert(args: Sequence[str]) -> int:
    """Carry out `encircle convert`, say what was done and return the exit code.

    Raises:
        SettingsError: If a name or a flag is not usable.
        LauncherError: If the map cannot be read or written.
    """
    asked = _parser().parse_args(args)
    source, target = asked.source, asked.target
    try:
        formats.check_read(source)
        formats.check_written(target, asked.mesh)
    except MapperError as error:
        raise SettingsError(str(error)) from error
    if asked.voxel is not None:
        if source.suffix != ".ply":
            raise SettingsError(f"--voxel is for points (.ply); {source} tells its own voxel size")
        if not (math.isfinite(asked.voxel) and asked.voxel > 0.0):
            raise SettingsError(f"--voxel {asked.voxel} must be positive and finite")
    try:
        stored = formats.read(source, asked.voxel)
        formats.write(stored, target, asked.mesh)
    except MapperError as error:
        raise LauncherError(str(error)) from error
    free, occupied = num_known(stored)
    print(
        f"{source}: {occupied} occupied and {free} free voxels of {stored.box.resolution_m:g} m, "
        f"{source.stat().st_size} bytes -> {target}: {target.stat().st_size} bytes"
    )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="encircle convert",
        description=_ABOUT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("source", metavar="IN", type=Path, help="map to read")
    parser.add_argument("target", metavar="OUT", type=Path, help="file to write or replace")
    parser.add_argument("--mesh", action="store_true", help="the surface, not points, as .ply")
    parser.add_argument(
        "--voxel", metavar="METRES", type=float, help="edge of a voxel, for points that tell none"
    )
    return parser
