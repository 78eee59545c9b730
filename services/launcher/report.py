"""What a run has shown, as numbers: `report.json`."""

import platform
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from schemas.map import MapSummary
from schemas.metrics import Missing, Quality, Score
from schemas.status import ServiceStatus
from services.launcher.series import Series
from services.launcher.target_error import TargetErrors

_PACKAGES = ("encircle", "numpy", "numba", "eclipse-zenoh", "pybullet", "open3d")
SHARES = tuple(name for name in Score.model_fields if name != "tolerance_m")
"""Of a score; `stamp_true.two_voxels.coverage` is such a column of `Record.scores`."""
_TOLERANCES = ("one_voxel", "two_voxels")
_SCORES = [
    f"{truth}.{tolerance}.{share}"
    for truth in ("stamp_true", "latency_true")
    for tolerance in _TOLERANCES
    for share in SHARES
]
_MISSING = [f"missing.{name}" for name in Missing.model_fields]


class Record:
    """What the services said during a run, as numbers; as large after a day as after an hour."""

    def __init__(self, num_cameras: int) -> None:
        self.num_cameras = num_cameras
        """At work now; may change."""
        self.instants = Series("latency_ms", "fuse_ms")
        """Of the map, each once."""
        self.scores = Series("t_s", *_MISSING, *_SCORES)
        self.num_ticks = 0
        self.complete = 0
        """Instants in which all cameras that were at work then were fused."""
        self.missed_clouds = 0
        self.tolerance_m: float | None = None
        """Of the newest score at two voxels."""
        self.span_ns: tuple[int, int] | None = None
        """When the first and the newest instant came, wall clock."""
        self.statuses: dict[tuple[str, str, int], ServiceStatus] = {}
        """The last heartbeat per service, instance and process; a restarted one counts anew."""
        self.first_cpu_s: dict[tuple[str, str, int], float] = {}
        """Processor time at the first heartbeat: starting up is not working."""
        self.target = TargetErrors()
        self._newest: MapSummary | None = None
        self._scored_tick: int | None = None
        self._first_is_complete = False

    def add_summary(self, summary: MapSummary, wall_ns: int) -> None:
        """Take in one fused instant; one that is told twice counts once."""
        if self._newest is not None and self._newest.rev == summary.rev:
            return
        is_complete = len(summary.cameras_used) >= self.num_cameras
        if self.span_ns is None:
            self.span_ns, self._first_is_complete = (wall_ns, wall_ns), is_complete
        self.span_ns = self.span_ns[0], wall_ns
        self.num_ticks += self._newest is None or self._newest.tick != summary.tick
        self.complete += is_complete
        self.missed_clouds += len(summary.cameras_missing)
        self.instants.add(summary.latency_ms, summary.fuse_ms)
        self._newest = summary

    def add_quality(self, quality: Quality) -> None:
        """Take in one scored instant; an instant scored twice counts by its last score."""
        missing = (getattr(quality.missing, name) for name in Missing.model_fields)
        scores = (*quality.stamp_true, *quality.latency_true)
        row = (getattr(score, name) for score in scores for name in SHARES)
        again = quality.tick == self._scored_tick
        put = self.scores.correct if again else self.scores.add
        put(quality.t_ns * 1e-9, *missing, *row)
        self._scored_tick, self.tolerance_m = quality.tick, quality.stamp_true[1].tolerance_m

    def add_status(self, status: ServiceStatus) -> None:
        """Take in one heartbeat."""
        process = (status.service, status.instance, status.pid)
        self.statuses[process] = status
        self.first_cpu_s.setdefault(process, status.cpu_s)

    @property
    def perceptions_per_s(self) -> float | None:
        """Complete instants per second of wall clock, first to last; None before the second."""
        if self.span_ns is None or len(self.instants) < 2:
            return None
        span_s = (self.span_ns[1] - self.span_ns[0]) * 1e-9
        return (self.complete - self._first_is_complete) / span_s if span_s > 0 else None


@dataclass(frozen=True)
class Run:
    """What the launcher itself knows."""

    mode: str
    seed: int
    dt_s: float
    voxel_size_m: float
    wall_s: float
    """First to last fused instant."""
    startup_s: float | None
    """Start of the first process to the first fused instant."""
    restarts: int


def report(record: Record, run: Run) -> dict[str, Any]:
    """Sum up a run.

    Scores are of the map against the surface at the map's own instant, at a tolerance of two
    voxels; `latency_true` is against the surface at the instant the map arrived, and `at` holds
    both tolerances. A figure that nothing was measured for is None.
    """
    return {
        "ticks": record.num_ticks,
        "cameras": record.num_cameras,
        "mode": run.mode,
        "wall_s": run.wall_s,
        "sim_s": record.num_ticks * run.dt_s,
        "startup_s": run.startup_s,
        "perceptions": record.complete,
        "perceptions_per_s": record.perceptions_per_s,
        "latency_ms": _percentiles(record.instants, "latency_ms"),
        "fuse_ms": _percentiles(record.instants, "fuse_ms"),
        **_scores(record.scores, "stamp_true.two_voxels"),
        "latency_true": _scores(record.scores, "latency_true.two_voxels"),
        "at": {name: _scores(record.scores, f"stamp_true.{name}") for name in _TOLERANCES},
        "missing": _missing(record.scores),
        "target": record.target.report(),
        "instants_scored": len(record.scores),
        "missed_clouds": record.missed_clouds,
        "bad_messages": sum(status.bad_messages for status in record.statuses.values()),
        "restarts": run.restarts,
        "voxel_size_m": run.voxel_size_m,
        "tolerance_m": record.tolerance_m,
        "seed": run.seed,
        "time": _time(record),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Return the versions of what computed the figures."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _time(record: Record) -> dict[str, dict[str, Any]]:
    """Return, per service over all its instances, processor time and the time of its stages."""
    found: dict[str, dict[str, Any]] = {}
    for process, status in record.statuses.items():
        row = found.setdefault(status.service, {"cpu_s": 0.0, "stages_s": {}})
        row["cpu_s"] += status.cpu_s - record.first_cpu_s[process]
        for stage in status.stages:
            row["stages_s"][stage.name] = row["stages_s"].get(stage.name, 0.0) + stage.total_s
    return found


def _scores(scores: Series, which: str) -> dict[str, Any]:
    def summary(share: str, *wanted: str) -> dict[str, float] | None:
        if not len(scores):
            return None
        figures = scores.figures(f"{which}.{share}")
        return {figure: figures[figure] for figure in wanted}

    return {
        "coverage": summary("coverage", "mean", "min", "final"),
        "coverage_observable": summary("coverage_observable", "mean", "min", "final"),
        "coverage_visible": summary("coverage_visible", "mean", "min"),
        "precision": summary("precision", "mean", "min"),
        "f_score": summary("f_score", "mean", "min"),
        "ghost_rate": summary("ghost_rate", "mean", "max"),
    }


def _missing(scores: Series) -> dict[str, float] | None:
    """Return the mean shares of the surface that are not in the map, by reason."""
    if not len(scores):
        return None
    return {name: scores.figures(f"missing.{name}")["mean"] for name in Missing.model_fields}


def _percentiles(instants: Series, name: str) -> dict[str, float] | None:
    if not len(instants):
        return None
    return {f"p{q}": instants.percentile(name, q) for q in (50, 95)}
