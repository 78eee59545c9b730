"""One mapper alone in a process of its own: CPU time per image, memory, classes.

    python benchmarks/mapping_run.py NAME SCENE.npz VOXEL ROUNDS CLASSES.npy

Prints one line of JSON: `ms` (rounds, images; the fast are measured again), `nodes_bytes`,
`steady_kib`, `peak_kib`.
"""

import ctypes
import gc
import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.mapping_rivals import RIVALS, Rival
from benchmarks.mapping_scenes import Scene

FAST_MS, AGAIN = 50.0, 4


def rounds_of(rival: Rival, num_images: int, rounds: int) -> list[list[float]]:
    """Fill an empty map; return the CPU time of every image of every round, ms."""
    rival.begin()
    times: list[list[float]] = []
    for _ in range(rounds):
        times.append([])
        for n in range(num_images):
            began = time.process_time()
            rival.fuse(n)
            times[-1].append((time.process_time() - began) * 1e3)
    return times


def kib(key: str) -> int:
    """Return a figure of /proc/self/status, KiB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key):
            return int(line.split()[1])
    raise KeyError(key)


def main() -> None:
    name, scene_path, voxel_m, rounds, classes_path = sys.argv[1:]
    scene = Scene.read(Path(scene_path))
    try:
        rival = RIVALS[name](scene, float(voxel_m))
    except ImportError as error:
        print(json.dumps({"absent": str(error)}))
        return
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)  # else the map grows into what was freed before.
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts from here.
    before = kib("VmRSS:")
    times = rounds_of(rival, len(scene.views), int(rounds))
    gc.collect()
    steady, peak = kib("VmRSS:") - before, kib("VmHWM:") - before
    held, classes = rival.num_bytes(), rival.classes()
    # A few milliseconds are measured often: on new maps, after the memory of the first is known.
    for _ in range(AGAIN if np.median(times) < FAST_MS else 0):
        more = rounds_of(rival, len(scene.views), int(rounds))
        times = [row + added for row, added in zip(times, more, strict=True)]
    measured = {"ms": times, "nodes_bytes": held, "steady_kib": steady, "peak_kib": peak}
    print(json.dumps(measured))
    if classes is not None:
        np.save(classes_path, classes)


if __name__ == "__main__":
    main()
