"""What a dead sender's pool occupied is free again; a living one's is not touched."""

import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from schemas.topics import CAMERA_CLOUD
from services.runtime.bus import Bus
from services.runtime.estate import SHM, Heir, Will, mapped
from services.runtime.reader import Reader
from tests.integration.mapper_world import depth_of

pytestmark = pytest.mark.integration

POOL_MIB = 16
ROOT = Path(__file__).parents[2]
SENDER = f"""
import sys, threading
import numpy as np
from schemas.topics import CAMERA_CLOUD
from services.runtime.bus import Bus
from services.runtime.settings import BusSettings
from tests.integration.mapper_world import large_cloud
endpoint, camera = sys.argv[1], int(sys.argv[2])
with Bus(BusSettings(connect=endpoint, shm_pool_mib={POOL_MIB}), "camera", str(camera)) as bus:
    for tick in range(1_000_000):
        bus.publish(CAMERA_CLOUD, large_cloud(tick, camera), camera=camera)
        threading.Event().wait(0.02)
"""


@contextmanager
def sender(endpoint: str, camera: int) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([sys.executable, "-c", SENDER, endpoint, str(camera)], cwd=ROOT)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def locked_kb() -> int:
    found = re.search(r"VmLck:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found
    return int(found[1])


def pools() -> dict[str, int]:
    """Names of the pools of that size that we have mapped, with their resident bytes."""
    large = {
        name
        for name, places in mapped().items()
        if sum(size for _, size in places) == POOL_MIB << 20
    }
    resident, name = dict.fromkeys(large, 0), ""
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if re.match(r"[0-9a-f]+-[0-9a-f]+ ", line):
            name = line.split("/")[-1].removesuffix(" (deleted)")
        elif line.startswith("Rss:") and name in large:
            resident[name] += int(line.split()[1]) << 10
    return resident


def hear(clouds: Reader, camera: int, timeout_s: float = 30.0) -> None:
    until_s = time.monotonic() + timeout_s
    while (heard := clouds.get(timeout_s).message).camera != camera:
        assert time.monotonic() < until_s
    depth = np.tile(depth_of(heard.tick, camera), (5, 5))
    np.testing.assert_array_equal(heard.array, depth)


def test_a_dead_senders_pool_is_given_back_and_a_living_ones_is_not(
    endpoint: str, open_bus: Callable[..., Bus]
) -> None:
    heir = Heir()
    heir.tend(), heir.tend()  # Of tests before us, in this process.
    mapper, before = open_bus("mapper"), set(pools())
    with mapper.latest(CAMERA_CLOUD) as clouds, sender(endpoint, 1) as living:
        hear(clouds, 1)
        (kept,) = set(pools()) - before
        with sender(endpoint, 2) as dying:
            hear(clouds, 2)
            (left,) = set(pools()) - before - {kept}
            assert heir.tend() == heir.tend() == 0, "somebody is taken for dead"
            locked = locked_kb()
            assert pools()[left] > 1 << 20
            dying.kill()
            dying.wait()
        until_s, given = time.monotonic() + 10.0, 0
        while not given and time.monotonic() < until_s:  # Twice, as it must be seen dead before.
            given = heir.tend()
            threading.Event().wait(0.1)
        assert given == POOL_MIB << 20
        assert locked_kb() <= locked - (POOL_MIB << 10)
        resident = pools()
        assert resident[left] == 0
        assert resident[kept] > 0
        assert heir.tend() == 0
        for _ in range(5):
            hear(clouds, 1)
        assert living.poll() is None


def test_a_note_is_gone_with_what_it_tells_of(tmp_path: Path) -> None:
    place = tmp_path / "encircle-0"
    heir = Heir(tmp_path)
    heir.tend()
    (place,) = tmp_path.iterdir()
    (place / "a.note").write_text("123.zenoh")
    (place / "b.note").write_text("../../etc/passwd")
    (tmp_path / "123.zenoh").touch()
    heir.tend()
    assert (place / "a.note").exists()
    (tmp_path / "123.zenoh").unlink()
    heir.tend()
    assert not (place / "a.note").exists()
    assert heir.tend() == 0


def test_what_is_not_certainly_ours_is_not_noted(tmp_path: Path) -> None:
    assert SHM.is_dir()
    assert not Will(tmp_path).enter(12345)
    assert list(tmp_path.iterdir()) == []
