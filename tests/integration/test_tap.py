"""Raw samples between real sessions: each byte, in order, and what is let go is counted."""

import threading
from collections.abc import Callable

import numpy as np
import pytest

from schemas.cloud import DepthCloud
from schemas.codec import encode
from schemas.message import Envelope
from schemas.topics import CAMERA_CLOUD, CAMERA_POSE, find
from services.runtime.bus import Bus
from services.runtime.errors import BadExpression
from services.runtime.tap import Sample, Tap
from tests.examples import EXAMPLES

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]


def wait_until_heard(bus: Bus, key: str) -> None:
    """Wait until somebody subscribes to `key`, by zenoh's own word."""
    matched = threading.Event()
    publisher = bus._sender.publisher(find(key), key)
    listener = publisher.declare_matching_listener(lambda s: s.matching and matched.set())
    try:
        assert publisher.matching_status.matching or matched.wait(10)
    finally:
        listener.undeclare()


def a_cloud(seed: int) -> bytes:
    example = EXAMPLES["depth_cloud"][1]
    fields = example.model_dump(exclude={"shape", "dtype", "data", "intrinsics", "camera"})
    optics = example.intrinsics.model_copy(update={"width": 640, "height": 480})
    image = np.random.default_rng(seed).integers(0, 5000, (480, 640)).astype("<u2")
    cloud = DepthCloud.of(image, **fields, intrinsics=optics, camera=0)
    return encode(cloud, Envelope(seq=seed, src="camera/0", boot="b", t_pub_ns=7)).join()


def test_whatever_bytes_are_republished_arrive_as_they_are_and_in_order(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("replay"), open_bus("recorder")
    rng = np.random.default_rng(1)
    keys = ["cams/0/pose", "target/pose", "nobody/knows/this", "cams/63/cloud"]
    sent = [(keys[i % 4], rng.bytes(int(rng.integers(0, 60_000)))) for i in range(60)]
    with Tap(receiver, ["**"]) as tap:
        for key in keys:
            wait_until_heard(sender, key)
        for key, payload in sent:
            sender.republish(key, payload)
        got = []
        while len(got) < len(sent):
            sample = tap.get(10)
            if sample.key in keys:
                got.append((sample.key, sample.payload))
    for key in keys:  # zenoh keeps the order of a key; two keys may have two priorities.
        assert [payload for k, payload in got if k == key] == [p for k, p in sent if k == key]


def test_clouds_go_by_shared_memory_and_the_envelope_is_untouched(open_bus: OpenBus) -> None:
    sender, receiver, mapper = open_bus("replay"), open_bus("recorder"), open_bus("mapper")
    with Tap(receiver, ["cams/*/cloud"]) as tap, mapper.every(CAMERA_CLOUD) as clouds:
        wait_until_heard(sender, "cams/0/cloud")
        for seed in range(10):
            sender.republish("cams/0/cloud", a_cloud(seed))
            assert tap.get(10).payload == a_cloud(seed)
            received = clouds.get(10)
            assert received.envelope == Envelope(seq=seed, src="camera/0", boot="b", t_pub_ns=7)
    assert sender.pool.used == 10
    (meter,) = [meter for meter in mapper.meters if not meter.sent]
    assert (meter.shared_memory, meter.lost) == (10, 0)


def test_expressions_that_overlap_bring_a_sample_once(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "0"), open_bus("recorder")
    with Tap(receiver, ["cams/0/*", "cams/*/pose", "cams/*/pose", "**"]) as tap:
        for key in ("cams/0/pose", "cams/1/pose"):
            wait_until_heard(sender, key)
        sender.republish("cams/0/pose", b"a")
        sender.republish("cams/1/pose", b"b")
        sender.republish("cams/1/pose", b"end")
        got = []
        while not got or got[-1] != b"end":
            got.append(tap.get(10).payload)
    assert sorted(got) == [b"a", b"b", b"end"]


def test_what_nobody_takes_is_bounded_and_the_oldest_go_and_are_counted(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "3"), open_bus("recorder")
    with Tap(receiver, ["cams/**"], max_bytes=8000) as tap, receiver.every(CAMERA_POSE) as poses:
        wait_until_heard(sender, "cams/3/pose")
        for _ in range(100):
            sender.publish(CAMERA_POSE, EXAMPLES["camera_pose"][1], camera=3)
        while poses.get(5).envelope.seq < 99:
            pass
        assert tap.waiting_bytes <= 8000
        tap.close()
        left: list[Sample] = []
        while tap.waiting_bytes:
            left.append(tap.get(1))
        with pytest.raises(TimeoutError):
            tap.get(0)
        assert len(left) + tap.dropped["cams/3/pose"] == 100
        assert 0 < len(left) < 20


def test_a_sample_is_stamped_by_its_receiver(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "3"), open_bus("recorder")
    with Tap(receiver, ["cams/3/pose"]) as tap:
        wait_until_heard(sender, "cams/3/pose")
        sender.republish("cams/3/pose", b"x")
        sender.republish("cams/3/pose", b"y")
        first, second = tap.get(5), tap.get(5)
    assert 0 < first.received_ns <= second.received_ns


def test_what_comes_after_closing_is_not_taken_in(open_bus: OpenBus) -> None:
    tap = Tap(open_bus("recorder"), ["map/*"])
    tap.add(Sample("map/full", b"in time", 0, None))
    tap.close()
    tap.add(Sample("map/full", b"too late", 0, None))
    assert tap.get(1).payload == b"in time"
    assert tap.waiting_bytes == 0


@pytest.mark.parametrize("expression", ["", "/cams", "cams//pose", "a#b"])
def test_what_is_no_key_expression_is_named(open_bus: OpenBus, expression: str) -> None:
    with pytest.raises(BadExpression, match="key expression"):
        Tap(open_bus("recorder"), [expression])
