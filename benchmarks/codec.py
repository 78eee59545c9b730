"""A 3.7 MB cloud, array ready to array ready in another process, beside a bare copy through memory.

The floor is what two processes cannot beat: copy the array into POSIX shared memory, send one byte
through a pipe, copy it out. Ours is the whole way: pydantic message, header, shared memory, zenoh,
header, validation, array. Both run in the same process pair, in alternating blocks: back to back,
and at 30 Hz, where every message finds cold caches and sleeping cores.

    python benchmarks/codec.py [--blocks 8]
"""

import argparse
import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory

import numpy as np
from machine import describe

from schemas.cloud import XyzCloud
from schemas.geometry import Pose
from schemas.topics import CAMERA_CLOUD
from services.runtime.bus import Bus
from services.runtime.router import router
from services.runtime.settings import BusSettings

SHAPE = (480 * 640, 3)
NUM_BYTES = SHAPE[0] * SHAPE[1] * 4
WARM_UP = 20
POSE = Pose(position=(0, 0, 0), orientation=(0, 0, 0, 1))
STAMP = {"t_ns": 0, "frame_id": "world", "camera": 0, "max_range_m": 5.0}


def receive(endpoint: str, name: str, pipe: Connection) -> None:
    """The other process: note when each array is ready to be used."""
    memory = SharedMemory(name=name)
    shared = np.ndarray(SHAPE, "<f4", memory.buf)
    with (
        Bus(BusSettings(connect=endpoint), "mapper") as bus,
        bus.subscribe(CAMERA_CLOUD, camera=0) as clouds,
    ):
        pipe.send("ready")
        while (order := pipe.recv()) != "end":
            pipe.send("go")
            if order == "floor":
                pipe.recv()
                array = shared.copy()
                ready_ns = time.monotonic_ns()
            else:
                array = clouds.get(5).message.array
                ready_ns = time.monotonic_ns()
            pipe.send((ready_ns, float(array[0, 0])))
    del shared, array
    memory.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blocks", type=int, default=8)
    num_blocks = parser.parse_args().blocks
    print(describe("eclipse-zenoh", "msgpack", "pydantic", "numpy"))

    buffer = bytearray(NUM_BYTES)
    array = np.frombuffer(buffer, "<f4").reshape(SHAPE)
    array[:] = np.random.default_rng(0).random(SHAPE, np.float32)
    memory = SharedMemory(create=True, size=NUM_BYTES)
    shared = np.ndarray(SHAPE, "<f4", memory.buf)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()

    with router() as endpoint, Bus(BusSettings(connect=endpoint), "camera", "0") as bus:

        def floor(_: int) -> int:
            here.send("floor")
            here.recv()
            start_ns = time.monotonic_ns()
            np.copyto(shared, array)
            here.send("copied")
            return start_ns

        def encircle(tick: int) -> int:
            here.send("encircle")
            here.recv()
            start_ns = time.monotonic_ns()
            cloud = XyzCloud.of(array, tick=tick, pose=POSE, t_capture_ns=0, **STAMP)
            bus.publish(CAMERA_CLOUD, cloud, camera=0)
            return start_ns

        child = context.Process(target=receive, args=(endpoint, memory.name, there))
        child.start()
        here.recv()
        while not bus.matching(CAMERA_CLOUD, 0):
            time.sleep(0.01)

        def latencies_ms(way: Callable[[int], int], count: int, period_s: float) -> list[float]:
            measured = []
            for tick in range(count):
                time.sleep(period_s)
                array[0, 0] = tick
                start_ns = way(tick)
                ready_ns, first = here.recv()
                assert first == tick, (first, tick)
                measured.append((ready_ns - start_ns) / 1e6)
            return measured[WARM_UP:]

        for name, count, period_s in (("back to back", 200, 0.0), ("30 Hz", 40, 1 / 30)):
            floor_ms: list[float] = []
            ours_ms: list[float] = []
            for _ in range(num_blocks):
                floor_ms += latencies_ms(floor, count, period_s)
                ours_ms += latencies_ms(encircle, count, period_s)
            ratio = np.median(ours_ms) / np.median(floor_ms)
            print(f"{name}: {ratio:.2f} x the floor, {len(ours_ms)} messages each")
            for label, values in (("floor", floor_ms), ("encircle", ours_ms)):
                p50, p95 = np.percentile(values, (50, 95))
                print(f"  {label:<9} p50 {p50:.2f} ms, p95 {p95:.2f} ms")
        here.send("end")
        child.join()
        pool = bus.pool
        print(f"by shared memory: {pool.used} of {pool.used + pool.missed}")
    shared = array
    memory.close()
    memory.unlink()


if __name__ == "__main__":
    main()
