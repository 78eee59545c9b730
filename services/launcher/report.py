"""What a run has shown, as numbers: `report.json`."""

import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

import numpy as np

from schemas.map import MapSummary
from schemas.metrics import Quality, Score
from schemas.status import ServiceStatus
from services.launcher.target_error import TargetErrors

_PACKAGES = ("encircle", "numpy", "numba", "eclipse-zenoh", "pybullet", "open3d")
_TOLERANCES = ("one_voxel", "two_voxels")


@dataclass
class Record:
    """What the services said during a run, instant by instant."""

    num_cameras: int
    """At work now; may change."""
    summaries: list[MapSummary] = field(default_factory=list)
    wall_ns: list[int] = field(default_factory=list)
    """When each summary came, wall clock."""
    whole: list[bool] = field(default_factory=list)
    """Whether all cameras that were at work then are in each summary."""
    qualities: list[Quality] = field(default_factory=list)
    statuses: dict[tuple[str, str, int], ServiceStatus] = field(default_factory=dict)
    """The last heartbeat per service, instance and process; a restarted one counts anew."""
    first_cpu_s: dict[tuple[str, str, int], float] = field(default_factory=dict)
    """Processor time at the first heartbeat: starting up is not working."""
    target: TargetErrors = field(default_factory=TargetErrors)

    def add_summary(self, summary: MapSummary, wall_ns: int) -> None:
        """Take in one fused instant; one that is told twice counts once."""
        if self.summaries and self.summaries[-1].rev == summary.rev:
            return
        self.summaries.append(summary)
        self.wall_ns.append(wall_ns)
        self.whole.append(len(summary.cameras_used) >= self.num_cameras)

    def add_quality(self, quality: Quality) -> None:
        """Take in one scored instant; an instant scored twice counts by its last score."""
        if self.qualities and self.qualities[-1].tick == quality.tick:
            self.qualities.pop()
        self.qualities.append(quality)

    def add_status(self, status: ServiceStatus) -> None:
        """Take in one heartbeat."""
        process = (status.service, status.instance, status.pid)
        self.statuses[process] = status
        self.first_cpu_s.setdefault(process, status.cpu_s)

    @property
    def complete(self) -> int:
        """Instants in which all cameras were fused."""
        return sum(self.whole)

    @property
    def perceptions_per_s(self) -> float | None:
        """Complete instants per second of wall clock, first to last; None before the second."""
        if len(self.summaries) < 2:
            return None
        span_s = (self.wall_ns[-1] - self.wall_ns[0]) * 1e-9
        return (self.complete - self.whole[0]) / span_s if span_s > 0 else None


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
    summaries, scores = record.summaries, [each.stamp_true[1] for each in record.qualities]
    ticks = {summary.tick for summary in summaries}
    return {
        "ticks": len(ticks),
        "cameras": record.num_cameras,
        "mode": run.mode,
        "wall_s": run.wall_s,
        "sim_s": len(ticks) * run.dt_s,
        "startup_s": run.startup_s,
        "perceptions": record.complete,
        "perceptions_per_s": record.perceptions_per_s,
        "latency_ms": _percentiles([each.latency_ms for each in summaries]),
        "fuse_ms": _percentiles([each.fuse_ms for each in summaries]),
        **_scores(scores),
        "latency_true": _scores([each.latency_true[1] for each in record.qualities]),
        "at": {
            name: _scores([each.stamp_true[index] for each in record.qualities])
            for index, name in enumerate(_TOLERANCES)
        },
        "missing": _missing(record.qualities),
        "target": record.target.report(),
        "instants_scored": len(record.qualities),
        "missed_clouds": sum(len(each.cameras_missing) for each in summaries),
        "bad_messages": sum(status.bad_messages for status in record.statuses.values()),
        "restarts": run.restarts,
        "voxel_size_m": run.voxel_size_m,
        "tolerance_m": scores[-1].tolerance_m if scores else None,
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


def _scores(scores: Sequence[Score]) -> dict[str, Any]:
    return {
        "coverage": _summary((each.coverage for each in scores), "mean", "min", "final"),
        "coverage_observable": _summary(
            (each.coverage_observable for each in scores), "mean", "min", "final"
        ),
        "coverage_visible": _summary((each.coverage_visible for each in scores), "mean", "min"),
        "precision": _summary((each.precision for each in scores), "mean", "min"),
        "f_score": _summary((each.f_score for each in scores), "mean", "min"),
        "ghost_rate": _summary((each.ghost_rate for each in scores), "mean", "max"),
    }


def _missing(qualities: Sequence[Quality]) -> dict[str, float] | None:
    """Return the mean shares of the surface that are not in the map, by reason."""
    if not qualities:
        return None
    rows = [each.missing.model_dump() for each in qualities]
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def _summary(values: Iterable[float], *figures: str) -> dict[str, float] | None:
    array = np.fromiter(values, np.float64)
    if not array.size:
        return None
    known = {"mean": array.mean(), "min": array.min(), "max": array.max(), "final": array[-1]}
    return {figure: float(known[figure]) for figure in figures}


def _percentiles(values: Sequence[float]) -> dict[str, float] | None:
    if not values:
        return None
    return {f"p{q}": float(np.percentile(values, q)) for q in (50, 95)}
