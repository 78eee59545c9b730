"""The panel shows what services report, and asks the one who reports."""

import math

import numpy as np
import pytest

from schemas.metrics import Missing, Quality, Score
from schemas.status import ServiceStatus, TopicStatus
from services.mapper.fusion import MemorySettings
from services.planner.formation import FormationSettings
from services.viewer.controls import CONTROLS, Choice, Number
from services.viewer.mishaps import Mishaps
from services.viewer.plots import NUM_SAMPLES, History, Plots

pytestmark = pytest.mark.unit

BY_LABEL = {control.label: control for control in CONTROLS}
REPORTS = {
    "planner": FormationSettings().model_dump(mode="json"),
    "mapper": MemorySettings().model_dump(),
    "simulator": {"object": "bunny", "deformation": "breathing:0.15:0.4"},
}


def test_every_control_shows_what_is_reported():
    shown = {control.label: control.shown(REPORTS) for control in CONTROLS}
    assert None not in shown.values()
    assert shown["Radius (m)"] == 1.1
    assert shown["Deformation"] == "breathing:0.15:0.4"


def test_without_a_report_there_is_nothing_to_show_and_nobody_to_ask():
    for control in CONTROLS:
        assert control.shown({}) is None
        assert control.request(1.0, {}) is None


def test_a_report_of_the_wrong_kind_is_not_shown():
    assert BY_LABEL["Radius (m)"].shown({"planner": {"radius_m": "far"}}) is None
    assert BY_LABEL["Strategy"].shown({"planner": {"strategy": 3}}) is None
    assert BY_LABEL["Cameras"].shown({"planner": {"cameras": True}}) is None


@pytest.mark.parametrize("value", [1e30, -1e30, 0.0, 65, 10**400, math.inf, math.nan, "6", True])
def test_a_number_beyond_its_limits_is_not_asked_for(value):
    with pytest.raises(ValueError, match=r"Cameras must be 1\.\.64, got "):
        BY_LABEL["Cameras"].request(value, REPORTS)
    assert BY_LABEL["Cameras"].request(64.0, REPORTS) == ("planner", {"cameras": 64})


@pytest.mark.parametrize("value", [10**400, math.inf, math.nan, None, [1.0]])
def test_a_number_that_is_none_is_not_shown(value):
    assert BY_LABEL["Radius (m)"].shown({"planner": {"radius_m": value}}) is None


def test_what_cannot_be_drawn_is_counted_and_told_until_it_can_be_again(caplog):
    mishaps = Mishaps()
    for _ in range(3):
        with mishaps.guarding("scene"):
            raise TypeError("no number")
    assert mishaps.num_failed == 3
    assert mishaps.lines == ["The scene cannot be shown: TypeError: no number"]
    assert caplog.text.count("cannot be shown") == 1
    with mishaps.guarding("scene"):
        pass
    assert mishaps.lines == []


def test_the_launcher_makes_cameras_and_without_one_the_planner_is_asked():
    cameras = BY_LABEL["Cameras"]
    assert cameras.request(4.0, REPORTS) == ("planner", {"cameras": 4})
    with_launcher = {**REPORTS, "launcher": {"cameras": 6}}
    assert cameras.request(4.0, with_launcher) == ("launcher", {"cameras": 4})


@pytest.mark.parametrize("label", ["Cameras", "Radius (m)", "Elevation (deg)", "Strategy"])
def test_what_is_asked_of_the_planner_is_what_it_takes(label):
    control = BY_LABEL[label]
    match control.kind:
        case Number(minimum, maximum, step):
            assert step > 0
            values = (minimum, maximum) if label != "Elevation (deg)" else (0.0, maximum)
        case Choice(choices):
            values = choices
    for value in values:
        service, params = control.request(value, REPORTS)
        assert service == "planner"
        FormationSettings().changed(params)


def test_the_choices_are_those_of_the_services():
    strategies = BY_LABEL["Strategy"].kind.choices
    assert set(strategies) == set(FormationSettings.model_fields["strategy"].annotation.__args__)
    memories = BY_LABEL["Map memory"].kind.choices
    assert set(memories) == set(MemorySettings.model_fields["memory"].annotation.__args__)


def test_a_history_keeps_the_last_samples_only():
    history = History(2)
    for step in range(1000):
        history.add(0.1 * step, step, -step)
    x, one, other = history.curves()
    assert len(x) == len(one) == len(other) == NUM_SAMPLES
    np.testing.assert_array_equal(one, np.arange(1000 - NUM_SAMPLES, 1000))
    np.testing.assert_array_equal(other, -one)


def test_a_new_run_begins_new_curves_and_what_is_told_twice_counts_once():
    history = History(1)
    history.add(5.0, 1.0)
    history.add(5.0, 2.0)
    np.testing.assert_array_equal(history.curves(), [[5.0], [2.0]])
    history.add(0.0, 3.0)
    np.testing.assert_array_equal(history.curves(), [[0.0], [3.0]])


def test_there_is_something_to_plot_before_the_first_sample():
    assert [len(column) for column in History(3).curves()] == [1] * 4


def heartbeat(camera, rate_hz):
    topic = TopicStatus(
        key=f"cams/{camera}/cloud", sent=True, count=9, rate_hz=rate_hz, declared_hz=15.0,
        alive=True, rate_ok=True, lost=0, bad=0, shared_memory=0,
    )  # fmt: skip
    known = {name: 0 for name, field in ServiceStatus.model_fields.items() if field.is_required()}
    return ServiceStatus(
        **{
            **known,
            "frame_id": "none",
            "service": "camera",
            "instance": str(camera),
            "shm_used": True,
            "version": "0.1.0",
            "host": "here",
            "topics": (topic,),
            "stages": (),
        }
    )


def test_each_camera_has_a_curve_and_one_that_has_fallen_silent_is_at_zero():
    plots = Plots()
    plots.sample_rates(0.0)
    assert plots.cameras == ()
    for camera in (2, 0):
        plots.add_status(heartbeat(camera, 10.0 + camera), 1.0)
    plots.sample_rates(1.0)
    plots.add_status(heartbeat(0, 11.0), 5.0)
    plots.sample_rates(5.0)
    assert plots.cameras == (0, 2)
    np.testing.assert_array_equal(plots.rates.curves(), [[1.0, 5.0], [10.0, 11.0], [12.0, 0.0]])


def test_coverage_is_plotted_in_percent_at_the_wider_tolerance():
    def score(share):
        return Score(
            tolerance_m=0.01, coverage=share, coverage_observable=share, coverage_visible=share,
            precision=1.0, f_score=share, ghost_rate=0.0,
        )  # fmt: skip

    both = (score(0.5), score(0.75))
    nothing = Missing(out_of_view=0, self_occluded=0, grazing=0, not_yet_updated=0)
    plots = Plots()
    plots.add_quality(
        Quality(
            t_ns=2_000_000_000, tick=3, frame_id="target", rev=4, stamp_true=both,
            latency_true=both, lag_ticks=0, missing=nothing, accuracy_m=None, completeness_m=None,
            chamfer_m=None, num_samples=1, num_voxels=1,
        )
    )  # fmt: skip
    x, *shares = plots.quality.curves()
    assert x.tolist() == [2.0]
    assert [share[0] for share in shares] == pytest.approx([75.0] * 3)
    assert math.isclose(x[0], 2.0)
