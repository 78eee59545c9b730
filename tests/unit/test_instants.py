"""Recorded clouds become instants, whatever the order in which they came."""

import numpy as np
import pytest

from schemas.codec import encode
from schemas.message import Envelope
from services.launcher.instants import Instants
from services.recorder.log_file import Record
from tests.examples import EXAMPLES

pytestmark = pytest.mark.unit

DT_NS = 66_666_666
CLOUD = EXAMPLES["depth_cloud"][1]
TARGET = EXAMPLES["target_pose"][1]


def record(key: str, message, log_ns: int) -> Record:
    envelope = Envelope(seq=0, src="s", boot="b", t_pub_ns=1)
    return Record(key, encode(message, envelope).join(), log_ns, 1, 0)


def cloud(tick: int, camera: int, log_ns: int = 0, **fields) -> Record:
    stamp = {"tick": tick, "t_ns": tick * DT_NS, "camera": camera, "frame_id": "world", **fields}
    return record(f"cams/{camera}/cloud", CLOUD.model_copy(update=stamp), log_ns)


def target(tick: int, log_ns: int = 0) -> Record:
    stamp = {"tick": tick, "t_ns": tick * DT_NS, "frame_id": "world"}
    return record("target/pose", TARGET.model_copy(update=stamp), log_ns)


def seen(records) -> list[tuple[int, tuple[int, ...]]]:
    return [
        (instant.tick, tuple(cloud.camera for cloud in instant.clouds))
        for instant in Instants().of(records)
    ]


def test_instants_come_in_order_whatever_the_order_of_arrival() -> None:
    rng = np.random.default_rng(2)
    records = [cloud(tick, camera) for tick in range(40) for camera in range(4)]
    expected = [(tick, (0, 1, 2, 3)) for tick in range(40)]
    assert seen(records) == expected
    for _ in range(5):  # Each record is late or early by less than eight ticks.
        late = np.arange(160) + rng.uniform(0, 4 * 7, 160)
        assert seen([records[index] for index in np.argsort(late)]) == expected


def test_a_camera_that_died_holds_nobody_up() -> None:
    records = [cloud(tick, camera) for tick in range(20) for camera in (0, 1) if tick < 5 or camera]
    assert seen(records)[4:6] == [(4, (0, 1)), (5, (1,))]


def test_a_run_that_begins_anew_is_another() -> None:
    run = [each for tick in range(30) for each in (target(tick), cloud(tick, 0))]
    assert seen([*run, *run]) == [(tick, (0,)) for tick in range(30)] * 2


def test_every_instant_has_the_targets_pose_of_its_tick() -> None:
    poses = {
        tick: TARGET.pose.model_copy(update={"position": (float(tick), 0.0, 0.0)})
        for tick in range(10)
    }
    records = []
    for tick, pose in poses.items():
        stamp = {"tick": tick, "t_ns": tick * DT_NS, "frame_id": "world", "pose": pose}
        records += [
            cloud(tick, 0),
            record("target/pose", TARGET.model_copy(update=stamp), 0),
        ]
    for instant in Instants().of(records):
        assert instant.T_world_target[0, 3] == instant.tick


def test_what_is_no_cloud_in_the_world_is_counted() -> None:
    instants = Instants()
    records = [
        Record("cams/0/cloud", b"junk", 0, 0, 0),
        cloud(3, 0, frame_id="target"),
        cloud(3, 1),
    ]
    (only,) = instants.of(records)
    assert [each.camera for each in only.clouds] == [1]
    assert instants.num_bad == 2
    assert only.T_world_target is None
