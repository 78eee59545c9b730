"""What a map still shows of a body that has moved on: OctoMap and ours, side by side.

A sphere and a bunny cross the space between six cameras, or before two of them, and rest in its
middle for a second; in a closed room, or in the open, where what is behind the body is often out of
range. Every map fuses the same clouds; OctoMap has its default model and casts a ray per voxel
that returns ("discretize"), with --rays per point.

"clear k, appear a" are the settings `frames_to_clear` and `frames_to_appear`; where they are not
told, OctoMap's model stays (9 and 3). "instant" knows each frame's clouds alone.

ghosts    occupied voxels farther than two voxels from everything that is there at that instant;
          mean over the frames, and in the last frame, when the body is gone. Occupied voxels inside
          the body are no ghosts; no camera can see them.
to clear  frames from when the body's surface is more than a voxel away from an occupied voxel until
          it is no longer occupied, 1 is at once: median, 99 of 100, greatest; "never" still stand
          at the end.
late      ghosts that cameras have looked through in `frames_to_clear` frames or more since the last
          return from them (all frames' sum); hidden are those that have been ghosts for so long and
          that no camera has looked through so often.
missing   share of what cameras see of the body that has no occupied voxel within two voxels; of
          the ground around it likewise.
CPU       process time of one camera's cloud, one thread.

    python benchmarks/moving_object.py [--size 320x240] [--voxel 0.02] [--rays] [--plot OUT.png]
"""

import argparse

import numpy as np
from machine import describe
from moving_judge import Record, judged
from moving_maps import Contender, contenders
from moving_scene import BOUNDS, MovingScene

from services.mapper.box import Box
from services.mapper.warm_up import warm_up

SHOWN = (
    ("sphere", False, 6),
    ("bunny", True, 6),
    ("sphere", True, 2),
    ("bunny", False, 2),
)
"""Body, in a closed room or not, cameras of the six."""
HEAD = (
    "                                    ghosts         to clear             late hidden"
    "    missing         CPU\n"
    "                                  mean  last    med  p99  max never                "
    "   body ground     ms"
)


def row(contender: Contender, record: Record) -> str:
    """Return the printed figures of a map."""
    frames = np.array(record.to_clear or [0])
    missing = float(np.mean(record.missing)) if record.missing else 0.0
    ground = float(np.mean(record.missing_ground))
    return (
        f"  {contender.name:28} {np.mean(record.ghosts):7.1f} {record.ghosts[-1]:5d}   "
        f"{np.median(frames):4.0f} {np.percentile(frames, 99):4.0f} {frames.max():4d} "
        f"{record.num_never:5d}   {record.num_late:6d} {record.num_hidden:6d}   "
        f"{missing:6.2%} {ground:6.2%} {contender.cpu_s / contender.num_images * 1e3:6.1f}"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--voxel", type=float, default=0.02)
    parser.add_argument("--frames", type=int, nargs="+", default=(1, 2, 3))
    parser.add_argument("--rays", action="store_true", help="OctoMap casts a ray per point")
    parser.add_argument("--plot", help="also draw the ghosts of every frame into this file")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    print(describe("pyoctomap", "numba", "numpy"))
    print(f"{arguments.size}, nguyen noise, {arguments.voxel * 1e3:g} mm voxels")
    warm_up()
    box = Box.covering(arguments.voxel, *BOUNDS)
    drawn = {}
    for kind, room, cameras in SHOWN:
        title = f"{kind}, {'closed room' if room else 'in the open'}, {cameras} cameras"
        scene = MovingScene(kind, (width, height), room=room, cameras=cameras)
        maps = contenders(arguments.voxel, arguments.frames, rays=arguments.rays)
        records = judged(scene, maps, box)
        print(f"\n{title}, {scene.num_instants} frames\n{HEAD}")
        for contender, record in zip(maps, records, strict=True):
            print(row(contender, record), flush=True)
        drawn[title] = [(m.name, r.ghosts) for m, r in zip(maps, records, strict=True)]
    if arguments.plot:
        from moving_plot import plot

        plot(drawn, arguments.plot)


if __name__ == "__main__":
    main()
