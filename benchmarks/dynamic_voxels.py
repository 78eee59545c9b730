"""Which occupied voxels are flagged dynamic, against what really moves.

The scenes of benchmarks/moving_object.py, after ten frames without the body: every instant, all
occupied voxels above the ground's layer. Dynamic in truth are those within a voxel of the body, or
in it. "left" are flagged voxels that the body has left and that are still occupied: they are all
wrong flags but those in the next column. Observing is the cost of flagging, per instant.

    python benchmarks/dynamic_voxels.py [--size 320x240] [--voxel 0.02]
"""

import argparse
import time

import numpy as np
from machine import describe
from moving_scene import BOUNDS, MovingScene, distance_m
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.mapper.box import Box
from services.mapper.ever_free import EverFreeWatch, Watch
from services.mapper.sensor_model import SensorModel
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up

SCENES = (("sphere", False, 6), ("bunny", True, 6), ("sphere", True, 2), ("bunny", False, 2))
MODELS = {
    "OctoMap's model": SensorModel(),
    "clear 2, appear 1": SensorModel.from_frames(2, 1),
    "clear 1, appear 1": SensorModel.from_frames(1, 1),
}
NUM_EMPTY = 10


class Timed:
    """A watch that knows what it cost."""

    def __init__(self, watch: Watch) -> None:
        self.watch, self.cpu_s = watch, 0.0

    def observe(self, *seen: object) -> None:
        """Observe."""
        began_s = time.process_time()
        self.watch.observe(*seen)  # type: ignore[arg-type]
        self.cpu_s += time.process_time() - began_s

    def __getattr__(self, name: str) -> object:
        return getattr(self.watch, name)


def numbers(box: Box, centres_m: FloatArray) -> NDArray[np.int64]:
    """Return (N,) one number per voxel."""
    numbers: NDArray[np.int64] = np.ravel_multi_index(tuple(box.keys(centres_m).T), box.shape)
    return numbers


def judged(scene: MovingScene, sensor: SensorModel, voxel_m: float) -> str:
    """Let the body cross a map; return the figures."""
    voxels = VoxelMap(voxel_m, *BOUNDS, sensor)
    watch = Timed(EverFreeWatch(voxels.box.num_bricks))
    voxels._watch = watch  # type: ignore[assignment]
    right = left = wrong = unflagged = 0
    was_body = np.empty(0, np.int64)
    for n in range(-NUM_EMPTY, scene.num_instants):
        instant = scene.instant(max(n, 0))  # At first the body is outside the box.
        voxels.fuse_many(instant.views)
        voxels.changes()
        occupied = voxels.occupied().centres_m
        occupied = occupied[occupied[:, 2] > 1.5 * voxel_m]
        at, flagged = numbers(voxels.box, occupied), numbers(voxels.box, voxels.dynamic().centres_m)
        is_flagged = np.isin(at, flagged)
        is_body = distance_m(instant.body, occupied) < voxel_m
        was_body = np.union1d(was_body, at[is_body])
        right += int((is_flagged & is_body).sum())
        unflagged += int((~is_flagged & is_body).sum())
        false = is_flagged & ~is_body
        left += int((false & np.isin(at, was_body)).sum())
        wrong += int((false & ~np.isin(at, was_body)).sum())
    flags = right + left + wrong
    return (
        f"{right / flags:8.1%} {right / (right + unflagged):8.1%} "
        f"{right / (flags + unflagged):8.1%} {left:7d} {wrong:6d} "
        f"{watch.cpu_s / (scene.num_instants + NUM_EMPTY) * 1e3:9.2f} ms"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--voxel", type=float, default=0.02)
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    print(describe("numba", "numpy"))
    print(f"{arguments.size}, nguyen noise, {arguments.voxel * 1e3:g} mm voxels")
    warm_up()
    print(f"{'':54}precision  recall      IoU    left  wrong  observing")
    for kind, room, cameras in SCENES:
        scene = MovingScene(kind, (width, height), room=room, cameras=cameras)
        title = f"{kind}, {'closed room' if room else 'in the open'}, {cameras} cameras"
        for name, sensor in MODELS.items():
            print(f"  {title:32} {name:18} {judged(scene, sensor, arguments.voxel)}", flush=True)


if __name__ == "__main__":
    main()
