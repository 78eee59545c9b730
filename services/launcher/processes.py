"""The process table of a run: who is started, with which flags."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field

from services.launcher.settings import RunSettings

# Eleven processes share the cores: a pool of threads in each would only wait for the others.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

Flags = Mapping[str, object]


@dataclass(frozen=True)
class ProcessSpec:
    """One process to keep alive."""

    name: str
    """Unique in the run: `service` or `service/instance`."""
    argv: tuple[str, ...]
    env: Mapping[str, str] = field(default_factory=dict)
    """On top of the launcher's own."""

    @property
    def service(self) -> str:
        """What it runs."""
        return self.name.partition("/")[0]

    @property
    def log_name(self) -> str:
        """Name of its log file, without the ending."""
        return self.name.replace("/", "-")


def process_table(settings: RunSettings, endpoint: str) -> tuple[ProcessSpec, ...]:
    """Return every process of a run, the router first.

    Args:
        settings: Of the run.
        endpoint: Where the router listens and all others connect, e.g. `tcp/127.0.0.1:7447`.
    """
    services = [
        _spec("simulator", _simulator(settings), endpoint),
        _spec("planner", _planner(settings), endpoint),
        _spec("mapper", _mapper(settings), endpoint),
    ]
    if settings.evaluator:
        services.append(_spec("evaluator", _evaluator(settings), endpoint))
    cameras = [
        _spec(f"camera/{index}", _camera(settings, index), endpoint)
        for index in range(settings.cameras)
    ]
    router = ProcessSpec("router", _argv("services.runtime.router", {"listen": endpoint}))
    return (router, *services, *cameras)


def _simulator(settings: RunSettings) -> Flags:
    evaluator = ("evaluator",) if settings.evaluator else ()
    return {
        "object": settings.object,
        "up": settings.up,
        "height-m": settings.height,
        "path": settings.path,
        "lap-s": settings.lap,
        "deformation": settings.deformation,
        "dt-s": settings.dt_s,
        "mode": settings.mode,
        "cameras": settings.cameras,
        "wait-for": ("planner", "mapper", *evaluator, "launcher"),
        "max-ticks": settings.num_ticks or 0,
        "seed": settings.seed,
    }


def _planner(settings: RunSettings) -> Flags:
    return {
        "strategy": settings.strategy,
        "cameras": settings.cameras,
        "radius-m": settings.radius,
        "elevation-deg": settings.elevation,
        "centre-height-m": settings.height / 2,
        "view-file": settings.view_file,
        "dwell-s": settings.dwell,
        "travel-s": settings.travel,
        "dt-s": settings.dt_s,
    }


def _camera(settings: RunSettings, index: int) -> Flags:
    width, height = settings.image_size
    return {
        "camera": index,
        "width": width,
        "height": height,
        "noise": settings.noise,
        "seed": settings.seed,
    }


def _mapper(settings: RunSettings) -> Flags:
    return {
        "voxel-size": settings.voxel_size,
        "memory": settings.memory,
        "frame": settings.frame,
        "box-min-m": settings.map_box[0],
        "box-max-m": settings.map_box[1],
    }


def _evaluator(settings: RunSettings) -> Flags:
    return {"radius-m": settings.radius, "seed": settings.seed}


def _spec(name: str, flags: Flags, endpoint: str) -> ProcessSpec:
    module = f"services.{name.partition('/')[0]}"
    return ProcessSpec(name, _argv(module, {**flags, "bus.connect": endpoint}), _ONE_THREAD)


def _argv(module: str, flags: Flags) -> tuple[str, ...]:
    argv = [sys.executable, "-m", module]
    for flag, value in flags.items():
        if value is not None:
            values = value if isinstance(value, tuple) else (value,)
            argv += [f"--{flag}", *(str(each) for each in values)]
    return tuple(argv)
