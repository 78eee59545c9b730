"""Curves of the cameras' rates, whoever comes and goes."""

import numpy as np
import pytest

from schemas.status import ServiceStatus, TopicStatus
from services.viewer.plots import Plots

pytestmark = pytest.mark.unit


def status(camera, rate_hz):
    stream = TopicStatus(
        key=f"cams/{camera}/cloud",
        sent=True,
        count=10,
        rate_hz=rate_hz,
        declared_hz=15,
        alive=True,
        rate_ok=True,
        lost=0,
        bad=0,
        shared_memory=0,
    )
    return ServiceStatus(
        t_ns=0,
        tick=0,
        frame_id="none",
        service="camera",
        instance=str(camera),
        pid=1,
        uptime_s=1,
        cpu_s=1,
        rss_bytes=1,
        shm_used=None,
        bad_messages=0,
        topics=(stream,),
        stages=(),
    )


def test_time_begins_with_the_first_sample():
    plots = Plots()
    for now_s in (9000.0, 9001.0, 9002.0):
        plots.add_status(status(0, 4.0), now_s)
        plots.sample_rates(now_s)
    seconds, rates = plots.rates.curves()
    np.testing.assert_array_equal(seconds, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(rates, [4.0, 4.0, 4.0])


def test_who_is_silent_stands_at_zero_and_is_forgotten_later():
    plots = Plots()
    for camera in (0, 1):
        plots.add_status(status(camera, 4.0), 100.0)
    plots.sample_rates(100.0)
    plots.add_status(status(0, 5.0), 104.0)
    plots.sample_rates(104.0)
    assert [curve[-1] for curve in plots.rates.curves()[1:]] == [5.0, 0.0]
    plots.add_status(status(0, 5.0), 131.0)
    plots.sample_rates(131.0)
    assert plots.cameras == (0,)
    assert plots.rates.curves()[1].tolist() == [5.0]
