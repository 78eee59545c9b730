"""The bus between real sessions: what is said arrives, what is wrong is counted."""

import threading
from collections.abc import Callable

import msgpack
import numpy as np
import pytest
import zenoh

from schemas.cloud import DepthCloud
from schemas.topics import CAMERA_CLOUD, CAMERA_POSE, MAP_CHANGES, SERVICE_STATUS, TARGET_POSE
from services.runtime.bus import Bus
from services.runtime.errors import BusUnavailable, CommandFailed, NoReply
from services.runtime.loop import Loop
from services.runtime.settings import BusSettings
from tests.examples import EXAMPLES
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]
POSE = EXAMPLES["camera_pose"][1]
TARGET = EXAMPLES["target_pose"][1]


def wait_until_read(bus: Bus, topic, camera: int | None = None) -> None:
    """Wait on zenoh's own matching status, with a bound."""
    key = topic.key_for(camera)
    matched = threading.Event()
    publisher = bus._sender.publisher(topic, key)
    listener = publisher.declare_matching_listener(lambda s: s.matching and matched.set())
    try:
        assert bus.matching(topic, camera) or matched.wait(10)
    finally:
        listener.undeclare()


def vga_cloud(camera: int = 0) -> DepthCloud:
    example = EXAMPLES["depth_cloud"][1]
    fields = example.model_dump(exclude={"shape", "dtype", "data", "intrinsics", "camera"})
    optics = example.intrinsics.model_copy(update={"width": 640, "height": 480})
    image = np.random.default_rng(0).integers(0, 5000, (480, 640)).astype("<u2")
    return DepthCloud.of(image, **fields, intrinsics=optics, camera=camera)


def test_a_subscriber_sees_what_was_published(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "3"), open_bus("planner")
    with receiver.subscribe(CAMERA_POSE) as poses:
        wait_until_read(sender, CAMERA_POSE, 3)
        sender.publish(CAMERA_POSE, POSE, camera=3)
        received = poses.get(5)
    assert received.message == POSE
    assert received.camera == 3
    assert received.envelope.src == "camera/3"
    assert received.envelope.seq == 0


def test_a_large_cloud_goes_by_shared_memory_and_arrives_whole(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "0"), open_bus("mapper")
    cloud = vga_cloud()
    with receiver.subscribe(CAMERA_CLOUD, camera=0) as clouds:
        wait_until_read(sender, CAMERA_CLOUD, 0)
        for _ in range(20):
            sender.publish(CAMERA_CLOUD, cloud, camera=0)
            assert clouds.get(5).message == cloud
    (meter,) = [m for m in receiver.meters if not m.sent]
    assert meter.shared_memory > 10
    assert sender.pool.in_use


def test_without_a_pool_a_large_cloud_goes_over_the_network(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "0"), open_bus("mapper")
    sender.pool._wanted_mib = 0
    with receiver.subscribe(CAMERA_CLOUD, camera=0) as clouds:
        wait_until_read(sender, CAMERA_CLOUD, 0)
        sender.publish(CAMERA_CLOUD, vga_cloud(), camera=0)
        assert clouds.get(5).message == vga_cloud()
    assert sender.pool.in_use is None


def test_a_pool_that_is_full_loses_nothing(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("camera", "0"), open_bus("mapper")
    with receiver.every(CAMERA_CLOUD, camera=0) as clouds:
        wait_until_read(sender, CAMERA_CLOUD, 0)
        for _ in range(40):  # 16 MiB hold 27; the reader keeps all that came.
            sender.publish(CAMERA_CLOUD, vga_cloud(), camera=0)
        got = [clouds.get(5).envelope.seq for _ in range(1)]
    assert got
    assert sender.pool.missed + sender.pool.used == 40


def test_a_large_cloud_that_nobody_reads_is_not_packed(open_bus: OpenBus) -> None:
    sender = open_bus("camera", "0")
    sender.publish(CAMERA_CLOUD, vga_cloud(), camera=0)
    assert sender.pool.in_use is None


def test_latest_wins_when_the_reader_is_slow(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("simulator"), open_bus("planner")
    with receiver.latest(TARGET_POSE) as slow, receiver.every(TARGET_POSE) as all_of_them:
        wait_until_read(sender, TARGET_POSE)
        for _ in range(50):
            sender.publish(TARGET_POSE, TARGET)
        while all_of_them.get(5).envelope.seq < 49:
            pass
        seen = [slow.get(5).envelope.seq]
        while seen[-1] < 49:  # Its thread may still be on its way there.
            seen.append(slow.get(5).envelope.seq)
    assert seen == sorted(seen)
    assert len(seen) < 25


def test_never_drop_keeps_all_in_order(open_bus: OpenBus) -> None:
    sender, receiver = open_bus("mapper"), open_bus("viewer")
    changes = EXAMPLES["map_changes"][1]
    with receiver.subscribe(MAP_CHANGES) as reader:
        wait_until_read(sender, MAP_CHANGES)
        for _ in range(100):
            sender.publish(MAP_CHANGES, changes)
        assert [reader.get(5).envelope.seq for _ in range(100)] == list(range(100))


def test_bad_bytes_are_counted_named_and_survived(endpoint: str, open_bus: OpenBus) -> None:
    receiver = open_bus("planner")
    config = zenoh.Config.from_json5(
        f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}, '
        "scouting: {multicast: {enabled: false}}}"
    )
    with zenoh.open(config) as stranger, receiver.subscribe(CAMERA_POSE) as poses:
        publisher = stranger.declare_publisher("cams/3/pose")
        matched = threading.Event()
        publisher.declare_matching_listener(lambda s: s.matching and matched.set())
        assert publisher.matching_status.matching or matched.wait(10)
        good = msgpack.packb(
            {"v": 1, "seq": 1, "src": "x", "boot": "y", "t_pub_ns": 1} | POSE.model_dump()
        )
        liar = msgpack.packb(msgpack.unpackb(good) | {"camera": 4})
        for payload in (b"", b"junk", good[:-3], liar):
            publisher.put(payload)
            with pytest.raises(TimeoutError):
                poses.get(0.2)
        publisher.put(good)
        assert poses.get(5).message == POSE
    (meter,) = [m for m in receiver.meters if m.key == "cams/3/pose"]
    assert meter.bad == 4
    assert "camera is 4; the key says 3" in receiver.last_refusal


def test_a_request_is_answered_and_an_error_is_clear(open_bus: OpenBus) -> None:
    asker, server = open_bus("launcher"), open_bus("mapper")
    loop = Loop(server)

    def refuse(params: dict) -> dict:
        raise ValueError(f"radius {params['radius']} must be 0.3..10 m")

    loop.serve("echo", lambda params: params)
    loop.serve("set", refuse)
    with running(loop):
        assert asker.request("mapper", "echo", {"a": [1, 2]}) == {"a": [1, 2]}
        with pytest.raises(CommandFailed, match=r"ctl/mapper/set: .*radius 99 must be"):
            asker.request("mapper", "set", {"radius": 99})
        with pytest.raises(CommandFailed, match="KeyError: 'radius'"):
            asker.request("mapper", "set")
        assert asker.request("mapper", "echo", {"still": "alive"}) == {"still": "alive"}


def test_a_request_that_nobody_serves_says_so(open_bus: OpenBus) -> None:
    with pytest.raises(NoReply, match="ctl/mapper/reset"):
        open_bus("launcher").request("mapper", "reset")


def test_liveliness_tells_who_comes_and_who_goes(open_bus: OpenBus) -> None:
    watcher = open_bus("mapper")
    seen: list[tuple[str, bool]] = []
    changed = threading.Condition()

    def note(instance: str, alive: bool) -> None:
        with changed:
            seen.append((instance, alive))
            changed.notify()

    loop = Loop(watcher)
    loop.on_alive("camera", note)
    with running(loop), changed:
        camera = open_bus("camera", "3")
        assert "camera/3" not in watcher.presence.everybody()
        camera.presence.announce()
        assert changed.wait_for(lambda: ("3", True) in seen, 10)
        assert "camera/3" in watcher.presence.everybody()
        camera.close()
        assert changed.wait_for(lambda: ("3", False) in seen, 10)


def test_the_heartbeat_shows_streams_stages_and_shared_memory(open_bus: OpenBus) -> None:
    sender, watcher = open_bus("camera", "0"), open_bus("launcher")
    loop = Loop(sender)
    with loop.stage("render"):
        pass
    with watcher.subscribe(CAMERA_CLOUD, camera=0), watcher.subscribe(SERVICE_STATUS) as beats:
        wait_until_read(sender, CAMERA_CLOUD, 0)
        sender.publish(CAMERA_CLOUD, vga_cloud(), camera=0)
        with running(loop):
            status = beats.get(5).message
    assert (status.service, status.instance) == ("camera", "0")
    assert status.shm_used is True
    assert [stage.name for stage in status.stages] == ["render"]
    assert any(topic.key == "cams/0/cloud" and topic.sent for topic in status.topics)
    assert status.rss_bytes > 10 << 20


def test_namespaces_do_not_hear_each_other(open_bus: OpenBus) -> None:
    sender = open_bus("simulator", namespace="a")
    same, other = open_bus("planner", namespace="a"), open_bus("planner", namespace="b")
    with same.subscribe(TARGET_POSE) as heard, other.subscribe(TARGET_POSE) as unheard:
        wait_until_read(sender, TARGET_POSE)
        sender.publish(TARGET_POSE, TARGET)
        assert heard.get(5).message == TARGET
        with pytest.raises(TimeoutError):
            unheard.get(0.3)


def test_a_malformed_endpoint_is_named() -> None:
    with pytest.raises(BusUnavailable, match="nonsense"):
        Bus(BusSettings(connect="", listen="nonsense"), "planner")
