"""The process table of a run: who is started, with which flags."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from services.launcher.camera_limits import camera_limits
from services.launcher.settings import RUNS_OWN, RunSettings

# Eleven processes share the cores: a pool of threads in each would only wait for the others.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_HEIGHT_SHARE = 1.25
"""How much higher another object may be: the map's box has been made and must hold it."""
_GROUND_M = 0.05
"""What is lower may be the ground and its noise; so may be the two lowest voxels."""

WATCHERS = ("viewer",)
"""Nobody waits for these, and a run goes on without them."""

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


def process_table(
    settings: RunSettings, endpoint: str, folder: Path | None = None
) -> tuple[ProcessSpec, ...]:
    """Return every process of a run, the router first.

    Args:
        settings: Of the run.
        endpoint: Where the router listens and all others connect, e.g. `tcp/127.0.0.1:7447`.
        folder: The only one in which the mapper may save; the working one when None.
    """
    services = [
        _spec("simulator", _simulator(settings), endpoint),
        _spec("planner", planner_flags(settings), endpoint),
        _spec("mapper", {**_mapper(settings), **_mapper_files(settings, folder)}, endpoint),
    ]
    if settings.evaluator:
        services.append(_spec("evaluator", _evaluator(settings), endpoint))
    cameras = [
        _spec(f"camera/{index}", _camera(settings, index), endpoint)
        for index in range(settings.cameras)
    ]
    if settings.record is not None:
        services.append(_recorder(settings, endpoint, folder or Path()))
    router = ProcessSpec("router", _argv("services.runtime.router", {"listen": endpoint}))
    viewer = [_spec("viewer", {"port": settings.viewer_port}, endpoint)] * settings.viewer
    return (router, *services, *cameras, *viewer)


def mapper_argv(settings: RunSettings) -> tuple[str, ...]:
    """Return the flags that the mapper of a run has of its settings."""
    return _argv("services.mapper", _mapper(settings))[3:]


def _simulator(settings: RunSettings) -> Flags:
    evaluator = ("evaluator",) if settings.evaluator else ()
    return {
        "object": settings.object,
        "up": settings.up,
        "height-m": settings.height,
        "path": settings.path,
        "lap-s": settings.lap,
        "semi-axes-m": settings.semi_axes,
        "deformation": settings.deformation,
        "dt-s": settings.dt_s,
        "mode": settings.mode,
        "cameras": settings.cameras,
        "wait-for": ("planner", "mapper", *evaluator, "launcher"),
        "max-ticks": settings.num_ticks or 0,
        "drive": "planned",
        "max-height-m": _HEIGHT_SHARE * settings.height,
        "actuator-lag-s": settings.actuator_lag,
        "actuator-noise-m-s": settings.actuator_noise,
        "actuator-noise-rad-s": settings.actuator_turn_noise,
        "seed": settings.seed,
        "target-noise-m": settings.target_noise_m,
        "target-noise-rad": settings.target_noise_rad,
        "target-delay-s": settings.target_delay_s,
        "target-dropout": settings.target_dropout,
    }


def planner_flags(settings: RunSettings) -> Flags:
    """Return what the planner of a run is told."""
    return {
        "strategy": settings.strategy,
        "drive": settings.drive,
        "cameras": settings.cameras,
        "radius-m": settings.radius,
        "elevation-deg": settings.elevation,
        "top-elevation-deg": settings.top_elevation,
        "rings": settings.rings,
        "radius-max-m": settings.radius_max,
        "forecast": settings.forecast,
        "horizon-s": settings.horizon,
        "orbit-deg-s": settings.orbit,
        "redraw-s": settings.redraw,
        "change-speed-mps": settings.change_speed,
        "safe-distance-m": settings.safe_distance,
        "seed": settings.seed,
        "centre-height-m": settings.height / 2,
        "view-file": settings.view_file,
        "dwell-s": settings.dwell,
        "travel-s": settings.travel,
        "dt-s": settings.dt_s,
        "infeasible": settings.infeasible,
        **{name.replace("_", "-"): value for name, value in camera_limits(settings).items()},
        # Who finds the target in a tracker's words or in the map is not told its way.
        "path": settings.path if settings.target == "given" else None,
        "semi-axes-m": settings.semi_axes,
        "lap-s": settings.lap,
        "target": settings.target,
        "ground-m": max(_GROUND_M, 2 * settings.voxel_size),
        "reach-m": 2 * settings.height,
    }


def _camera(settings: RunSettings, index: int) -> Flags:
    width, height = settings.image_size
    return {
        "camera": index,
        "width": width,
        "height": height,
        "vfov-deg": settings.vfov,
        "drive": "planned",
        "unicycle.controller": settings.controller,
        "noise": settings.noise,
        "seed": settings.seed,
    }


def _mapper(settings: RunSettings) -> Flags:
    return {
        "voxel-size": settings.voxel_size,
        "memory": settings.memory,
        "half-life-s": settings.half_life,
        "frames-to-clear": settings.frames_to_clear,
        "frames-to-appear": settings.frames_to_appear,
        "frame": settings.frame,
        "follow": settings.follow,
        "archive": () if settings.archive else None,
        "box-min-m": settings.map_box[0],
        "box-max-m": settings.map_box[1],
    }


def _mapper_files(settings: RunSettings, folder: Path | None) -> Flags:
    """Return where it may save, and what it comes back from when it was killed."""
    keeps = folder is not None and settings.memory == "persistent" and settings.follow == "none"
    return {"files": folder, "snapshot": folder / "snapshot.npz" if folder and keeps else None}


def _evaluator(settings: RunSettings) -> Flags:
    return {"radius-m": settings.radius, "seed": settings.seed}


def _recorder(settings: RunSettings, endpoint: str, folder: Path) -> ProcessSpec:
    file = folder / "recording.mcap" if settings.record == RUNS_OWN else settings.record
    # Started again after a crash, it takes the next name: what is there is never lost.
    flags = {"numbered": (), "about": settings.model_dump_json(), "bus.connect": endpoint}
    python, option, module, *rest = _argv("services.recorder", flags)
    return ProcessSpec("recorder", (python, option, module, str(file), *rest), _ONE_THREAD)


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
