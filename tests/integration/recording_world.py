"""Senders, a recorder and a replay in one process, for tests of recordings."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from schemas.cloud import DepthCloud
from schemas.codec import encode
from schemas.map import MapChanges, MapFull
from schemas.message import Envelope
from schemas.topics import find
from services.recorder.replay_service import ReplayService
from services.recorder.service import RecorderService
from services.recorder.settings import RecorderSettings, ReplaySettings
from services.runtime.bus import Bus
from services.runtime.loop import Loop
from services.runtime.tap import Tap
from tests.examples import EXAMPLES
from tests.integration.conftest import running

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


def a_cloud(seed: int, camera: int = 0) -> DepthCloud:
    example = EXAMPLES["depth_cloud"][1]
    fields = example.model_dump(exclude={"shape", "dtype", "data", "intrinsics", "camera"})
    optics = example.intrinsics.model_copy(update={"width": 640, "height": 480})
    image = np.random.default_rng(seed).integers(0, 5000, (480, 640)).astype("<u2")
    return DepthCloud.of(image, **fields, intrinsics=optics, camera=camera)


def a_map(rng: np.random.Generator, rev: int) -> MapFull:
    example = EXAMPLES["map_full"][1].model_dump(exclude={"shape", "dtype", "data"})
    bricks = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    log_odds = rng.integers(-20000, 20000, (27, 512))
    log_odds[rng.random((27, 512)) < 0.3] = -32768
    rows = np.concatenate([bricks, log_odds], axis=1).astype("<i2")
    return MapFull.of(rows, **{**example, "rev": rev, "shape_voxels": (24, 24, 24)})


def some_changes(rng: np.random.Generator, rev: int, base_rev: int, num: int = 200) -> MapChanges:
    example = EXAMPLES["map_changes"][1].model_dump(exclude={"shape", "dtype", "data"})
    voxels = np.unique(rng.integers(0, 24, (num, 3)), axis=0)
    rows = np.concatenate([voxels, rng.integers(0, 3, (len(voxels), 1))], axis=1).astype("<i2")
    full = EXAMPLES["map_full"][1]
    same = {"resolution_m": full.resolution_m, "origin": full.origin, "frame_id": full.frame_id}
    shape = {"shape_voxels": (24, 24, 24), "rev": rev, "base_rev": base_rev}
    return MapChanges.of(rows, **{**example, **same, **shape})


def packed(message, seq: int, src: str = "mapper", boot: str = "b") -> bytes:
    return encode(message, Envelope(seq=seq, src=src, boot=boot, t_pub_ns=7)).join()


@contextmanager
def recording(bus: Bus, path: Path, **settings: object) -> Iterator[Loop]:
    """Record for the length of the block."""
    loop = Loop(bus)
    service = RecorderService(RecorderSettings(file=path, **settings), bus, loop)
    with running(loop):
        yield loop
    assert service is not None


@contextmanager
def replaying(bus: Bus, path: Path, **settings: object) -> Iterator[Loop]:
    """Replay; the block begins when it is about to."""
    loop = Loop(bus)
    service = ReplayService(ReplaySettings(file=path, **settings), bus, loop)
    with running(loop):
        yield loop
    assert service is not None


def until(tap: Tap, key: str, num: int) -> list[bytes]:
    """Take samples until there are `num` of a key; return their payloads."""
    got: list[bytes] = []
    while len(got) < num:
        sample = tap.get(10)
        if sample.key == key:
            got.append(sample.payload)
    return got
