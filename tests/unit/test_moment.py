"""Times of a recording, and what was known when."""

import numpy as np
import pytest

from schemas.geometry import WORLD, Pose, Twist
from schemas.map import OCCUPIED, MapChanges
from schemas.target import TargetPose
from schemas.topics import MAP_CHANGES, TARGET_POSE
from services.recorder.export.decoded import Decoded
from services.recorder.export.errors import ExportError
from services.recorder.export.moment import moments
from services.recorder.export.timeline import Timeline

pytestmark = pytest.mark.unit

SECOND_NS = 1_000_000_000
KEYS = {"target/pose", "map/changes"}


def pose_at(tick):
    stamp = {"t_ns": tick * SECOND_NS, "tick": tick, "frame_id": WORLD}
    pose = Pose(position=(tick, 0, 0), orientation=(0, 0, 0, 1))
    twist = Twist(linear=(1, 0, 0), angular=(0, 0, 0))
    return Decoded(
        "target/pose", TARGET_POSE, None, TargetPose(**stamp, pose=pose, twist=twist), "s", 0
    )


def changes_at(tick, rev, base_rev, boot="m"):
    message = MapChanges.of(
        np.array([[tick, 0, 0, OCCUPIED]], np.int16),
        t_ns=tick * SECOND_NS,
        tick=tick,
        frame_id="target",
        rev=rev,
        base_rev=base_rev,
        resolution_m=0.1,
        origin=(0, 0, 0),
        shape_voxels=(100, 8, 8),
        pose=Pose(position=(0, 0, 0), orientation=(0, 0, 0, 1)),
    )
    return Decoded("map/changes", MAP_CHANGES, None, message, boot, 0)


def seen(messages, times):
    return [(m.tick, m.elapsed_s, len(m.mirror)) for m in moments(messages, Timeline(KEYS), times)]


def run(num):
    for tick in range(num):
        yield pose_at(tick)
        yield changes_at(tick, tick + 1, tick)


def test_a_moment_holds_all_of_its_instant_and_nothing_of_the_next():
    times = [0.0, 0.99, 1.0, 2.5, 4.0]
    assert seen(run(5), times) == [(0, 0, 1), (0, 0, 1), (1, 1, 2), (2, 2, 3), (4, 4, 5)]


def test_times_after_the_end_are_not_there_but_one_alone_has_the_last():
    assert [tick for tick, *_ in seen(run(3), [1.0, 2.0, 3.0])] == [1, 2]
    assert [tick for tick, *_ in seen(run(3), [7.0])] == [2]


def test_time_goes_on_where_a_simulation_began_anew():
    again = [*run(3), *run(3)]
    ticks = [(tick, elapsed_s) for tick, elapsed_s, _ in seen(again, [0, 1, 2, 3, 4])]
    assert ticks == [(0, 0), (1, 1), (0, 2), (1, 3), (2, 4)]


def test_another_mapper_begins_another_map_and_a_gap_is_counted():
    said = [pose_at(0), changes_at(0, 1, 0), pose_at(1), changes_at(1, 9, 7), pose_at(2)]
    said += [changes_at(2, 1, 0, boot="other"), pose_at(3)]
    found = [(len(m.mirror), m.num_gaps) for m in moments(said, Timeline(KEYS), [0, 1, 2, 3])]
    assert found == [(1, 0), (1, 1), (1, 1), (1, 1)]
    last = list(moments(said, Timeline(KEYS), [3]))[-1]
    assert last.mirror.voxels.tolist() == [[2, 0, 0]]


def test_the_way_of_the_target_is_remembered():
    (last,) = moments(run(4), Timeline(KEYS), [3.0])
    assert [(t, place[0]) for t, place in last.trail] == [(0, 0), (1, 1), (2, 2), (3, 3)]


def test_the_clock_is_the_best_that_was_recorded():
    assert Timeline({"sim/state", "target/pose"}).clock == "sim/state"
    assert Timeline({"cams/3/cloud", "cams/1/cloud"}).clock == "cams/1/cloud"
    with pytest.raises(ExportError, match=r"no clock: none of sim/state"):
        Timeline({"metrics/planner"})
