"""The report: what the services said, summed up."""

import json

import numpy as np
import pytest

from schemas.map import MapSummary
from schemas.metrics import Missing, Quality, Score
from schemas.status import ServiceStatus
from services.launcher.chart import draw
from services.launcher.report import Record, Run, report

pytestmark = pytest.mark.unit

DT_S = 0.1
RUN = Run(
    mode="lockstep",
    seed=3,
    dt_s=DT_S,
    voxel_size_m=0.01,
    wall_s=9.0,
    startup_s=2.0,
    restarts=1,
)
DEMANDED = set(
    [
        "ticks",
        "cameras",
        "mode",
        "wall_s",
        "sim_s",
        "perceptions_per_s",
        "latency_ms",
        "fuse_ms",
        "coverage",
        "coverage_observable",
        "coverage_visible",
        "precision",
        "f_score",
        "ghost_rate",
        "missed_clouds",
        "bad_messages",
        "restarts",
        "voxel_size_m",
        "tolerance_m",
        "seed",
        "versions",
    ]
)


def summary(tick, used=(0, 1, 2), missing=(), fuse_ms=5.0, latency_ms=20.0):
    return MapSummary(
        t_ns=int(tick * DT_S * 1e9),
        tick=tick,
        frame_id="target",
        rev=tick + 1,
        cameras_used=used,
        cameras_missing=missing,
        num_returns=1000,
        num_occupied=100,
        num_free=1000,
        num_changed=10,
        fuse_ms=fuse_ms,
        latency_ms=latency_ms,
        memory="instant",
    )


def score(coverage, tolerance_m=0.02):
    precision = 1 - coverage / 10
    return Score(
        tolerance_m=tolerance_m,
        coverage=coverage,
        coverage_observable=min(1.0, coverage * 1.1),
        coverage_visible=min(1.0, coverage * 1.2),
        precision=precision,
        f_score=2 * precision * coverage / (precision + coverage),
        ghost_rate=1 - precision,
    )


def quality(tick, coverage):
    return Quality(
        t_ns=int(tick * DT_S * 1e9),
        tick=tick,
        frame_id="target",
        rev=tick + 1,
        stamp_true=(score(coverage / 2, 0.01), score(coverage)),
        latency_true=(score(coverage / 4, 0.01), score(coverage / 3)),
        lag_ticks=0,
        missing=Missing(
            out_of_view=0.0, self_occluded=1 - coverage, grazing=0.0, not_yet_updated=0.0
        ),
        accuracy_m=0.003,
        completeness_m=0.004,
        chamfer_m=0.0035,
        num_samples=10000,
        num_voxels=100,
    )


def status(pid, bad):
    return ServiceStatus(
        t_ns=0,
        tick=0,
        frame_id="none",
        service="mapper",
        instance="0",
        pid=pid,
        uptime_s=1,
        cpu_s=1,
        rss_bytes=1,
        shm_used=True,
        bad_messages=bad,
        topics=(),
        stages=(),
    )


def record_of(coverages, num_cameras=3):
    record = Record(num_cameras)
    for tick, coverage in enumerate(coverages):
        record.add_summary(summary(tick), wall_ns=int(tick * 5e8))
        record.add_quality(quality(tick, coverage))
    return record


def test_a_report_has_every_key_that_is_promised_and_is_json():
    result = report(record_of([0.5, 0.9]), RUN)
    assert set(result) >= DEMANDED
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_a_run_in_which_nothing_happened_has_figures_of_none():
    result = report(Record(3), RUN)
    assert set(result) >= DEMANDED
    assert result["coverage"] is result["fuse_ms"] is result["perceptions_per_s"] is None
    assert result["ticks"] == result["missed_clouds"] == 0


def test_scores_are_summed_up_over_the_instants_at_two_voxels():
    coverages = np.random.default_rng(0).uniform(0.1, 0.8, 50)
    result = report(record_of(coverages), RUN)
    assert result["coverage"] == pytest.approx(
        {"mean": coverages.mean(), "min": coverages.min(), "final": coverages[-1]}
    )
    assert result["ghost_rate"]["max"] == pytest.approx(coverages.max() / 10)
    assert result["precision"]["min"] == pytest.approx(1 - coverages.max() / 10)
    assert result["tolerance_m"] == 0.02
    assert result["latency_true"]["coverage"]["mean"] == pytest.approx(coverages.mean() / 3)
    assert result["at"]["one_voxel"]["coverage"]["mean"] == pytest.approx(coverages.mean() / 2)
    assert result["missing"]["self_occluded"] == pytest.approx(1 - coverages.mean())


def test_only_instants_with_all_cameras_are_perceptions():
    record = Record(3)
    for tick in range(5):
        lost = (2,) if tick in (1, 3) else ()
        used = tuple(camera for camera in range(3) if camera not in lost)
        record.add_summary(summary(tick, used, lost), wall_ns=int(tick * 1e9))
    result = report(record, RUN)
    assert result["perceptions"] == 3
    assert result["perceptions_per_s"] == pytest.approx(2 / 4)  # Two more after the first, in 4 s.
    assert result["missed_clouds"] == 2
    assert result["sim_s"] == pytest.approx(5 * DT_S)


def test_percentiles_are_of_the_instants():
    record = Record(3)
    for tick in range(101):
        record.add_summary(summary(tick, fuse_ms=tick, latency_ms=2 * tick), wall_ns=tick)
    result = report(record, RUN)
    assert result["fuse_ms"] == {"p50": 50, "p95": 95}
    assert result["latency_ms"] == {"p50": 100, "p95": 190}


def test_an_instant_that_is_told_twice_counts_once():
    record = Record(num_cameras=3)
    for tick, wall_ns in ((0, 0), (1, 10**9), (1, 5 * 10**9)):
        record.add_summary(summary(tick), wall_ns)
    assert record.complete == 2
    assert record.perceptions_per_s == pytest.approx(1.0)


def test_an_instant_that_is_scored_twice_counts_once():
    record = Record(3)
    record.add_quality(quality(4, 0.3))
    record.add_quality(quality(4, 0.7))
    assert report(record, RUN)["coverage"] == {"mean": 0.7, "min": 0.7, "final": 0.7}


def test_bad_messages_survive_a_restart():
    record = Record(3)
    for pid, bad in ((10, 1), (10, 4), (11, 2)):
        record.add_status(status(pid, bad))
    assert report(record, RUN)["bad_messages"] == 6


@pytest.mark.parametrize("num_instants", [0, 1, 60])
def test_the_chart_is_a_picture_however_long_the_run(tmp_path, num_instants):
    pytest.importorskip("matplotlib")
    path = tmp_path / "coverage.png"
    draw(record_of(np.linspace(0.5, 0.9, num_instants)), path, "hexagon")
    assert path.read_bytes().startswith(b"\x89PNG")
