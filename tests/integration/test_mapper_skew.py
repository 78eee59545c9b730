"""A camera whose clock is an hour off is fused, told once, and does not spoil the latency."""

import time

import pytest

from schemas.codec import encode
from schemas.message import Envelope
from services.mapper.warm_up import warm_up
from tests.integration.mapper_world import OpenBus, cloud, worlds

pytestmark = pytest.mark.integration

HOUR_NS = 3600 * 10**9


@pytest.mark.parametrize("off_ns", [-HOUR_NS, HOUR_NS])
def test_the_map_goes_on_with_a_camera_whose_clock_is_off(
    open_bus: OpenBus, caplog, off_ns: int
) -> None:
    warm_up()
    with worlds(open_bus) as begin:
        world = begin(deadline_s=10.0)
        for tick in range(5):
            world.tell_target(tick)
            world.send(tick, 0, 2)
            off = cloud(tick, 1)
            off = off.model_copy(update={"t_capture_ns": off.t_capture_ns + off_ns})
            stamp = Envelope(seq=tick, src="camera/1", boot="b", t_pub_ns=time.time_ns() + off_ns)
            world.cameras[1].republish("cams/1/cloud", encode(off, stamp).join())
            summary = world.answer()[1]
            assert summary.cameras_used == (0, 1, 2)
            assert 0.0 < summary.latency_ms < 10_000.0
    lines = [record.getMessage() for record in caplog.records if "clock" in record.getMessage()]
    assert len(lines) == 1
    assert "camera 1: its stamps are 3600 s" in lines[0]
