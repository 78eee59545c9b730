"""A camera that is there and says nothing is one line in the mapper's log, not one per instant."""

import pytest

from services.mapper.warm_up import warm_up
from tests.integration.mapper_world import OpenBus, worlds

pytestmark = pytest.mark.integration


def test_a_silent_camera_is_one_line_however_many_instants_pass(open_bus: OpenBus, caplog) -> None:
    warm_up()
    with worlds(open_bus) as begin:
        world = begin(deadline_s=1.0)
        world.instant(0, 0, 1, 2)
        for tick in range(1, 30):
            assert world.instant(tick, 0, 2)[1].cameras_missing == (1,)
        tick = 30
        while world.instant(tick, 1, 0, 2)[1].cameras_missing:  # Not waited for until it speaks.
            tick += 1
    lines = [record.getMessage() for record in caplog.records if "cameras" in record.getMessage()]
    assert lines == ["tick 1: nothing from cameras 1", f"tick {tick}: cameras 1 speak again"]
