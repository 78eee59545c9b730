"""Draw the README's picture from a run: the ring of cameras, and the map that they made.

encircle run --headless --duration 4 --save-map map.ply
python docs/picture.py map.ply docs/hexagon.png
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from services.kernels.rigid import apply, look_at

NUM_CAMERAS, RADIUS_M, ELEVATION_RAD = 6, 1.1, np.radians(20)
CENTRE_M = np.array([0.0, 0.0, 0.2])
HALF_FOV_RAD = np.radians(22.5)
VOXEL_M = 0.01
INK, CAMERA, FAINT = "#333333", "#D55E00", "#BBBBBB"


def camera_poses() -> list[NDArray[np.float64]]:
    """Return the hexagon's views in the target's frame."""
    poses = []
    for i in range(NUM_CAMERAS):
        angle = np.pi * (2 * i / NUM_CAMERAS - 1)
        level = np.cos(ELEVATION_RAD)
        ray = np.array([level * np.cos(angle), level * np.sin(angle), np.sin(ELEVATION_RAD)])
        poses.append(look_at(CENTRE_M + RADIUS_M * ray, CENTRE_M))
    return poses


def frustum(T: NDArray[np.float64], depth_m: float) -> NDArray[np.float64]:
    """Return apex and the four corners of a view, world."""
    y = depth_m * np.tan(HALF_FOV_RAD)
    x = y * 4 / 3
    corners = [[0, 0, 0], [-x, -y, depth_m], [x, -y, depth_m], [x, y, depth_m], [-x, y, depth_m]]
    return apply(T, np.array(corners, float))


def draw_ring(axes: Axes3D) -> None:
    """Draw the hexagon and what each camera looks at."""
    poses = camera_poses()
    eyes = np.array([T[:3, 3] for T in poses])
    axes.add_collection3d(Poly3DCollection([eyes], facecolor="none", edgecolor=CAMERA, lw=1.2))
    for T in poses:
        apex, *corners = frustum(T, 0.16)
        sides = [[apex, corner] for corner in corners]
        axes.add_collection3d(Poly3DCollection([corners], color=CAMERA, alpha=0.35))
        axes.add_collection3d(Line3DCollection(sides, color=CAMERA, lw=1.0))
        axes.add_collection3d(Line3DCollection([[apex, CENTRE_M]], color=FAINT, lw=0.7))


def draw_map(axes: Axes3D, centres_m: NDArray[np.float64], size: float) -> None:
    """Draw occupied voxels, coloured by height."""
    axes.scatter(
        *centres_m.T, c=centres_m[:, 2], cmap="viridis", s=size, marker="s", linewidths=0, alpha=1.0
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("out", type=Path)
    args = parser.parse_args()
    centres_m = np.asarray(trimesh.load(args.map).vertices, float)
    body = centres_m[centres_m[:, 2] > VOXEL_M]

    figure = Figure(figsize=(12, 4.6), layout="constrained")
    ring = figure.add_subplot(1, 2, 1, projection="3d")
    draw_ring(ring)
    ground = centres_m[centres_m[:, 2] <= VOXEL_M]
    ring.scatter(*ground[::6].T, c="#DDDDDD", s=0.4, linewidths=0)
    draw_map(ring, body, 1.6)
    ring.set(xlim=(-0.85, 0.85), ylim=(-0.85, 0.85), zlim=(0, 0.9))
    ring.set_box_aspect((1.7, 1.7, 0.9), zoom=1.12)
    ring.view_init(elev=30, azim=-72)
    near = figure.add_subplot(1, 2, 2, projection="3d")
    draw_map(near, body, 15)
    middle = (body.min(0) + body.max(0)) / 2
    reach = np.ptp(body, axis=0).max() / 2
    near.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        zlim=(middle[2] - reach, middle[2] + reach),
    )
    near.set_box_aspect((1, 1, 1), zoom=1.35)
    near.view_init(elev=14, azim=-60)
    for axes, title in (
        (ring, "six cameras look at the same instant"),
        (near, f"{len(body)} occupied voxels of 1 cm, from that instant alone"),
    ):
        axes.set_axis_off()
        axes.set_title(title, color=INK, fontsize=12, y=-0.06)
    figure.savefig(args.out, dpi=90)


if __name__ == "__main__":
    main()
