"""`encircle export`: a recording as what others open: Foxglove's MCAP, points, a film."""

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from services.launcher.errors import LauncherError, SettingsError
from services.launcher.extras import check_installed

_ABOUT = """\
Make of a recording what others open.

  --to foxglove   .mcap in Foxglove's schemas, for Foxglove, Lichtblick and Rerun
  --to ply        .ply points: the map of one instant, or (--merged) all cameras' clouds of it
  --to video      .mp4, .gif or .webp of the scene, or .png of one instant, by the name's ending"""
_ENDINGS = {"foxglove": ".foxglove.mcap", "ply": ".ply", "video": ".mp4"}

M = TypeVar("M", bound=BaseModel)


def export(args: Sequence[str]) -> int:
    """Carry out `encircle export`, say what was made and return the exit code.

    Raises:
        SettingsError: If a name or a flag is not usable.
        MissingExtraError: If what it needs is not installed.
        LauncherError: If the recording cannot be read, or nothing can be made of it.
    """
    asked = _parser().parse_args(args)
    check_installed("export")
    from services.mapper.errors import MapperError
    from services.recorder.errors import RecorderError
    from services.recorder.log_file import RecordedLog

    out = asked.out or asked.file.with_suffix(_ENDINGS[asked.to])
    if out.resolve() == asked.file.resolve():
        raise SettingsError(f"--out {out} is the recording itself; give another name")
    make = {"foxglove": _foxglove, "ply": _ply, "video": _video}[asked.to]
    try:
        with RecordedLog(asked.file) as log:
            said = make(log, out, asked)
            for sentence in log.lost:
                print(f"encircle export: {asked.file}: {sentence}", file=sys.stderr)
    except (RecorderError, MapperError) as error:
        raise LauncherError(f"{asked.file}: {error}") from error
    except OSError as error:
        raise LauncherError(f"{error.filename or asked.file}: {error.strerror or error}") from error
    print(f"{asked.file} -> {out}: {said}, {out.stat().st_size} bytes")
    return 0


def _foxglove(log: Any, out: Path, asked: argparse.Namespace) -> str:
    from services.recorder.export.foxglove_file import FoxgloveSettings, write_foxglove

    given = {"pixel_step": asked.pixel_step, "map_every_s": asked.map_every}
    if out.suffix != ".mcap":
        raise SettingsError(f"--out {out} must end in .mcap")
    made = write_foxglove(log, out, _settled(FoxgloveSettings, given), _progress())
    return (
        f"{made.num_messages} messages of {made.recorded_s:.1f} s in {made.took_s:.1f} s"
        f"{_troubles(made.num_gaps, made.num_bad)}"
    )


def _video(log: Any, out: Path, asked: argparse.Namespace) -> str:
    from services.recorder.export.film import FilmSettings, film
    from services.recorder.export.film_file import ENDINGS

    if out.suffix not in ENDINGS:
        raise SettingsError(f"--out {out} must end in one of {', '.join(ENDINGS)}")
    size = re.fullmatch(r"(\d+)x(\d+)", asked.size)
    if size is None:
        raise SettingsError(f"--size {asked.size!r} must be WIDTHxHEIGHT, e.g. 960x540")
    given = {
        "width": int(size[1]),
        "height": int(size[2]),
        "fps": asked.fps,
        "speed": asked.speed,
        "start_s": asked.start,
        "end_s": asked.end,
        "theme": asked.theme,
        "view": asked.view,
        "azimuth_deg": asked.azimuth,
        "elevation_deg": asked.elevation,
        "zoom": asked.zoom,
        "follow": asked.follow,
        "trail_s": asked.trail,
        "grid_m": asked.grid,
        "wedges": asked.wedges,
        "insets": asked.insets,
        "caption": asked.caption,
        "supersample": asked.supersample,
    }
    made = film(log, out, _settled(FilmSettings, given), _progress())
    return (
        f"{made.num_pictures} pictures, {made.film_s:.1f} s, drawn in {made.took_s:.1f} s"
        f"{_troubles(made.num_gaps, made.num_bad)}"
    )


def _ply(log: Any, out: Path, asked: argparse.Namespace) -> str:
    from schemas.topics import CAMERA_CLOUD, MAP_CHANGES, MAP_FULL
    from services.launcher.export_points import cloud_ply, voxel_ply
    from services.mapper import safe_file
    from services.recorder.export.reading import Reading

    if out.suffix != ".ply":
        raise SettingsError(f"--out {out} must end in .ply")
    reading = Reading(log)
    topics = (CAMERA_CLOUD,) if asked.merged else (MAP_CHANGES, MAP_FULL)
    reading.require(topics[0], "--merged" if asked.merged else "a map")
    moment = next(iter(reading.moments(topics, [_instant(reading.ticks(), asked)])))
    data, num = cloud_ply(moment) if asked.merged else voxel_ply(moment)
    safe_file.replace(out, data)
    latest = moment.mirror.latest
    frame = "world" if latest is None else latest.frame_id
    what = "points" if asked.merged else "occupied voxels"
    return (
        f"{num} {what}, frame {frame}, tick {moment.tick}, t {moment.elapsed_s:.3f} s"
        f"{_troubles(moment.num_gaps, reading.decoder.bad.total())}"
    )


def _instant(ticks: list[tuple[int, float]], asked: argparse.Namespace) -> float:
    """Return the time of the instant that is asked for, s since the first."""
    last_s = ticks[-1][1]
    if asked.tick is not None:
        times = [t_s for tick, t_s in ticks if tick == asked.tick]
        if not times:
            first, last = ticks[0][0], ticks[-1][0]
            raise SettingsError(f"--tick {asked.tick} was not recorded; there are {first}..{last}")
        return times[-1]
    if asked.at is None:
        return last_s
    if not 0 <= asked.at <= last_s:
        raise SettingsError(f"--at {asked.at:g} s must be within 0..{last_s:.3f} s")
    return float(asked.at)


def _settled(kind: type[M], given: dict[str, Any]) -> M:
    try:
        return kind.model_validate(given)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        name = str(fault["loc"][0]) if fault["loc"] else "settings"
        flag = name.removesuffix("_s").removesuffix("_deg").removesuffix("_m").replace("_", "-")
        raise SettingsError(f"--{flag} {fault['input']}: {fault['msg']}") from error


def _troubles(num_gaps: int, num_bad: int) -> str:
    gaps = f"; {num_gaps} changes of the map lack what they build on" if num_gaps else ""
    bad = f"; {num_bad} messages could not be read" if num_bad else ""
    return gaps + bad


def _progress() -> Callable[[float], None]:
    """Return what shows a share on a terminal, and says nothing elsewhere."""
    if not sys.stderr.isatty():
        return lambda _: None
    return lambda share: print(f"\r{100 * min(share, 1.0):3.0f} %", end="\r", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="encircle export",
        description=_ABOUT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("file", metavar="FILE", type=Path, help="recording of `encircle record` or `run --record`")
    add("--to", choices=tuple(_ENDINGS), required=True)
    add("--out", type=Path, help="file to write or replace; beside FILE if not given")
    points = parser.add_argument_group("foxglove")
    points.add_argument("--pixel-step", type=int, default=4, metavar="N",
                        help="every Nth pixel, each way, also as a point; 0: none (4)")  # fmt: skip
    points.add_argument("--map-every", type=float, default=0.0, metavar="S",
                        help="the map at most so often, s; 0: with every change (0)")  # fmt: skip
    ply = parser.add_argument_group("ply")
    when = ply.add_mutually_exclusive_group()
    when.add_argument("--at", type=float, metavar="S", help="s since the first instant (the last)")
    when.add_argument("--tick", type=int, metavar="N", help="the same by number")
    ply.add_argument("--merged", action="store_true", help="the clouds, not the map")
    _add_video(parser.add_argument_group("video"))
    return parser


def _add_video(group: Any) -> None:
    add, switch = group.add_argument, argparse.BooleanOptionalAction
    add("--size", default="960x540", metavar="WxH", help="pixels (960x540)")
    add("--fps", type=float, default=15.0, help="pictures per second (15)")
    add("--speed", type=float, default=1.0, help="recorded seconds per second of film (1)")
    add("--start", type=float, default=0.0, metavar="S", help="s since the first instant (0)")
    add("--end", type=float, metavar="S", help="the same; the recording's end if not given")
    add("--theme", default="light", help="light or dark (light)")
    add("--view", default="orbit", help="orbit: once around; sway: to and fro; still (orbit)")
    add("--azimuth", type=float, default=-90.0, metavar="DEG", help="of the view (-90)")
    add("--elevation", type=float, default=28.0, metavar="DEG", help="of the view (28)")
    add("--zoom", type=float, default=1.0, help="1: the ring of cameras fits (1)")
    add("--follow", action=switch, default=True, help="keep the target in the middle (yes)")
    add("--trail", type=float, default=4.0, metavar="S", help="of the target's way (4)")
    add("--grid", type=float, default=0.5, metavar="M", help="squares of the ground (0.5)")
    add("--wedges", action=switch, default=True, help="what each camera has in view (yes)")
    add("--insets", action=switch, default=True, help="the cameras' depth images (yes)")
    add("--caption", action=switch, default=True, help="time, counts, quality (yes)")
    add("--supersample", type=int, default=2, metavar="N", help="for soft edges, 1 to 4 (2)")
