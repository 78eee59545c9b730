"""`encircle remap`: a recording's clouds into a map with other settings, faster than they came."""

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from services.launcher.errors import LauncherError, SettingsError
from services.launcher.extras import check_installed


def remap(args: Sequence[str]) -> int:
    """Carry out `encircle remap`, say what was done and return the exit code.

    Raises:
        MissingExtraError: If what is needed is not installed.
        SettingsError: If a flag is not usable.
        LauncherError: If the recording cannot be read or the map not be written.
    """
    check_installed("recorder")
    from services.launcher.remap_settings import RemapSettings, recorded_argv
    from services.mapper.errors import MapperError
    from services.mapper.warm_up import warm_up
    from services.recorder.errors import RecorderError
    from services.recorder.log_file import RecordedLog
    from services.runtime.service import parse

    # Its run's settings come before the flags, and are in the file: that is looked for first.
    if args and not args[0].startswith("-"):
        file: Path | None = Path(args[0])
    else:
        file = parse(RemapSettings, "remap", args).file
    if file is None:
        raise SettingsError("name a recording, e.g. `encircle remap out.mcap --voxel-size 0.005`")
    try:
        with RecordedLog(file) as log:
            recorded, where_from = recorded_argv(log)
            settings = parse(RemapSettings, "remap", [*recorded, *args])
            for written in (settings.out, settings.json_):
                if written is not None:
                    _check_writable(written, file)
            for sentence in log.lost:
                print(f"{file}: {sentence}")
            print(f"{file}: what is not given is as in {where_from}")
            warm_up()
            figures = _remap(log, settings)
    except OSError as error:
        raise LauncherError(f"{file} cannot be read: {error.strerror}") from error
    except (RecorderError, MapperError) as error:
        raise LauncherError(str(error)) from error
    _tell(figures)
    if settings.json_ is not None:
        with _writing(settings.json_):
            settings.json_.write_text(json.dumps(figures, indent=2) + "\n")
    return 0


def _check_writable(path: Path, recording: Path) -> None:
    """See to it before the work that a file can be written, and is not the recording."""
    if path.exists() and path.samefile(recording):
        raise SettingsError(f"{path} is the recording, which would be lost: give another name")
    there = path.exists()
    with _writing(path):
        path.open("ab").close()
        if not there:
            path.unlink()


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise LauncherError(f"{path} cannot be written: {error.strerror or error}") from error


def _remap(log: Any, settings: Any) -> dict[str, Any]:
    from schemas.topics import CAMERA_CLOUD, TARGET_POSE, find
    from services.launcher.instants import Instants
    from services.launcher.remapping import Remapping

    start_ns = log.start_ns + round(settings.start * 1e9)
    end_ns = None if settings.duration is None else start_ns + round(settings.duration * 1e9)
    topics = (CAMERA_CLOUD, TARGET_POSE)
    records = log.records(start_ns, end_ns, lambda key: find(key) in topics)
    scores = _scores(log, settings)
    remapping, instants, span = Remapping(settings), Instants(), _Span()
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    for instant in instants.of(span.of(records)):
        changes = remapping.fuse(instant)
        if changes is not None and scores is not None:
            scored_s, scored_cpu_s = time.perf_counter(), time.process_time()
            scores.add(changes)
            began_s += time.perf_counter() - scored_s
            began_cpu_s += time.process_time() - scored_cpu_s
    took_s, cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
    if not remapping.num_instants:
        raise LauncherError(
            f"{log.path}: nothing to fuse: {remapping.num_homeless} instants without a pose of the "
            f"target, {instants.num_bad} messages that are not valid"
        )
    voxel_map = remapping.fusion.voxel_map
    if settings.out is not None:
        with _writing(settings.out):
            voxel_map.save(settings.out)
    counts = voxel_map.counts()
    return {
        "clouds": remapping.num_clouds,
        "instants": remapping.num_instants,
        "recorded_s": span.length_s,
        "took_s": took_s,
        "cpu_s": cpu_s,
        "times_real_time": span.length_s / took_s,
        "occupied": counts.occupied,
        "free": counts.free,
        "voxel_m": settings.voxel_size,
        "without_target": remapping.num_homeless,
        "bad": instants.num_bad,
        "refused": remapping.refused[:100],
        "scores": None if scores is None else scores.means(),
        "map": None if settings.out is None else str(settings.out),
    }


class _Span:
    """How long what passes through took to be recorded."""

    def __init__(self) -> None:
        self._first_ns = self._last_ns = 0

    def of(self, records: Iterator[Any]) -> Iterator[Any]:
        for record in records:
            self._first_ns = self._first_ns or record.log_ns
            self._last_ns = record.log_ns
            yield record

    @property
    def length_s(self) -> float:
        return (self._last_ns - self._first_ns) * 1e-9


def _scores(log: Any, settings: Any) -> Any:
    if not settings.score:
        return None
    check_installed("evaluator")
    from services.evaluator.open3d_loader import open3d
    from services.evaluator.settings import EvaluatorSettings
    from services.launcher.remap_scores import RemapScores

    open3d()
    about = log.metadata.get("settings", {}).get("run", "")
    return RemapScores(log, _radius_m(log, about) if about else EvaluatorSettings().radius_m)


def _radius_m(log: Any, about: str) -> float:
    try:
        return float(json.loads(about)["radius"])
    except (ValueError, TypeError, KeyError):
        raise LauncherError(
            f"{log.path}: --score needs the run's radius, and what is recorded of the run has "
            f"none: {about[:80]!r}"
        ) from None


def _tell(figures: dict[str, Any]) -> None:
    print(
        f"{figures['clouds']} clouds of {figures['instants']} instants, recorded in "
        f"{figures['recorded_s']:.1f} s, fused in {figures['took_s']:.1f} s: "
        f"{figures['times_real_time']:.1f} x as fast as they came"
    )
    where = f" -> {figures['map']}" if figures["map"] else "; --out writes it"
    print(
        f"the last map has {figures['occupied']} occupied and {figures['free']} free voxels of "
        f"{figures['voxel_m']:g} m{where}"
    )
    if figures["scores"] is not None:
        told = ", ".join(f"{name} {value:.1%}" for name, value in figures["scores"].items())
        print(f"mean over the instants: {told}")
    if figures["without_target"] or figures["bad"] or figures["refused"]:
        print(
            f"not fused: {figures['without_target']} instants without a pose of the target, "
            f"{figures['bad']} messages that are not valid, {len(figures['refused'])} clouds "
            f"refused{': ' + figures['refused'][0] if figures['refused'] else ''}"
        )
