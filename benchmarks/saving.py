"""What it costs to write a map as OctoMap's file, and how near its surface is to the true one.

Files: six 640 x 480 views of a scene on a plate in a box of 2.56 x 2.56 x 1.28 m. The peer is
pyoctomap: every known voxel put into its tree, then its own writer; CPU time, median of five, one
run of the peer. Surfaces: the bunny, 0.4 m high, alone in free space, seen from all round;
distances of the mesh's vertices to the true surface, and how much of what was seen has the mesh
nearby. Marching cubes of the bare classes stand beside.

    python benchmarks/saving.py [--rounds 5]
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from machine import describe
from mapping_scene import camera_pose, depth_image
from pyoctomap import OcTree

from services.evaluator.open3d_loader import open3d
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import look_at
from services.mapper import npz_file, octree_file, ply_file, surface_mesh
from services.mapper.stored_map import StoredMap
from services.mapper.voxel_map import VoxelMap
from services.world.mesh import Mesh, load_mesh

SHAPE, PINHOLE = (480, 640), (579.0, 579.0, 319.5, 239.5)
LOW, HIGH = (-1.28, -1.28, -0.1), (1.28, 1.28, 1.18)
DISTANCE_M, SCALE_M, MARGIN_M = 1.1, 0.0001, 0.1
NOISE_M, NOISE_PER_M2 = 0.0005, 0.0012


def milliseconds(work: Callable[[], object], rounds: int) -> float:
    """Return the median CPU time of a call."""
    work()
    spent = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return 1e3 * float(np.median(spent))


def scene(voxel_m: float) -> VoxelMap:
    """Fuse the six views."""
    rng, voxels = np.random.default_rng(0), VoxelMap(voxel_m, LOW, HIGH)
    for k in range(6):
        T = camera_pose(0.13 + k * np.pi / 3, 1.2, 0.75, 0.2)
        voxels.fuse_depth(depth_image(SHAPE, PINHOLE, T, rng), PINHOLE, T)
    return voxels


def peers_way(voxels: VoxelMap, path: Path) -> tuple[float, bytes]:
    """Write a map through pyoctomap; return CPU milliseconds and the file."""
    occupied, free = voxels.occupied().centres_m, voxels.free().centres_m
    start = time.process_time()
    tree = OcTree(voxels.box.resolution_m)
    tree.updateNodes(occupied, True, True)
    tree.updateNodes(free, False, True)
    tree.updateInnerOccupancy()
    tree.writeBinary(str(path))
    return 1e3 * (time.process_time() - start), path.read_bytes()


def files(rounds: int) -> None:
    """Print what writing and reading cost."""
    print(f"{'file':<18}{'bytes':>12}{'write ms':>10}{'read ms':>10}")
    for voxel_m in (0.01, 0.005):
        voxels = scene(voxel_m)
        stored, counts = voxels.stored(), voxels.counts()
        print(f"{voxel_m * 1000:g} mm: {counts.occupied} occupied, {counts.free} free voxels")
        formats = {
            ".bt": (octree_file.bt_bytes, octree_file.read_bt),
            ".ot": (octree_file.ot_bytes, octree_file.read_ot),
            ".npz": (npz_file.npz_bytes, npz_file.read_npz),
            ".ply": (ply_file.ply_bytes, ply_file.read_ply),
        }
        for name, (write, read) in formats.items():
            data = write(stored)
            written = milliseconds(partial(write, stored), rounds)
            loaded = milliseconds(partial(read, data), rounds)
            print(f"  {name:<16}{len(data):>12}{written:>10.1f}{loaded:>10.1f}")
        with tempfile.TemporaryDirectory() as folder:
            spent, data = peers_way(voxels, Path(folder) / "peer.bt")
        same = "the same bytes" if data == octree_file.bt_bytes(stored) else "OTHER BYTES"
        print(f"  {'.bt, pyoctomap':<16}{len(data):>12}{spent:>10.1f}  ({same})")


def bunny_seen(
    mesh: Mesh, num_views: int, voxel_m: float, noise: bool
) -> tuple[VoxelMap, set[int]]:
    """Fuse views from all round; return the map and the triangles that were seen."""
    vertices, faces = mesh.vertices_m.astype(np.float64), mesh.faces
    low, high, rng = vertices.min(axis=0), vertices.max(axis=0), np.random.default_rng(0)
    voxels, seen = VoxelMap(voxel_m, low - MARGIN_M, high + MARGIN_M), set()
    n = np.arange(num_views) + 0.5
    z, angle = 1 - 2 * n / num_views, np.pi * (1 + 5**0.5) * n
    for x, y, up in zip(*(np.sqrt(1 - z * z) * (np.cos(angle), np.sin(angle))), z, strict=True):
        centre = (low + high) / 2
        T = look_at(centre + DISTANCE_M * np.array([x, y, up]), centre)
        in_camera = np.empty_like(vertices)
        to_camera(vertices, T, in_camera)
        depth, triangle = np.full(SHAPE, np.inf, np.float32), np.full(SHAPE, -1, np.int32)
        rasterise(in_camera, faces, np.array(PINHOLE), 0.1, depth, triangle)
        there = np.isfinite(depth)
        depth = np.where(there, depth, 0.0)
        if noise:
            depth += rng.normal(size=SHAPE) * (NOISE_M + NOISE_PER_M2 * depth**2)
        image = np.where(there, np.round(depth / SCALE_M), 65535).astype(np.uint16)
        voxels.fuse_depth(image, PINHOLE, T, SCALE_M, 5.0)
        seen |= set(np.unique(triangle[there]).tolist())
    return voxels, seen


def bare(stored: StoredMap) -> tuple[np.ndarray, np.ndarray]:
    """Return marching cubes of free against all else: what most tools would do."""
    from skimage.measure import marching_cubes

    log_odds = VoxelMap.from_stored(stored).log_odds_dense()
    field = np.where(np.isnan(log_odds) | (log_odds >= 0), 1.0, -1.0)
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="ascent")
    return stored.box.centres_m(vertices), faces


def compare(
    vertices_m: np.ndarray, faces: np.ndarray, mesh: Mesh, seen: set[int], voxel_m: float
) -> str:
    """Return how near a surface is to the true one."""
    o3d = open3d()

    def caster(v: np.ndarray, f: np.ndarray) -> object:
        built = o3d.t.geometry.RaycastingScene()
        built.add_triangles(
            o3d.core.Tensor(v.astype(np.float32)), o3d.core.Tensor(f.astype(np.uint32))
        )
        return built

    used = vertices_m[np.unique(faces)].astype(np.float32)
    true = caster(mesh.vertices_m, mesh.faces)
    off = true.compute_signed_distance(o3d.core.Tensor(used)).numpy() / voxel_m
    middles = mesh.vertices_m[mesh.faces[sorted(seen)]].mean(axis=1)
    missed = caster(vertices_m, faces).compute_distance(o3d.core.Tensor(middles)).numpy() / voxel_m
    size = np.abs(off)
    return (
        f"{size.mean():>8.3f}{np.quantile(size, 0.95):>8.3f}{size.max():>8.2f}{off.mean():>+8.3f}"
        f"{100 * (missed < 0.5).mean():>9.1f}{100 * (missed < 1).mean():>9.1f}{len(faces):>10}"
    )


def surfaces(rounds: int) -> None:
    """Print how near surfaces are."""
    mesh = load_mesh("bunny", 0.4)
    columns = (
        f"{'mean':>8}{'95 %':>8}{'worst':>8}{'outward':>8}{'< 1/2':>9}{'< 1 vox':>9}{'faces':>10}"
    )
    print(f"{'surface, voxels':<36}{columns}{'ms':>8}")
    for num_views, voxel_m, noise in ((6, 0.01, 0), (12, 0.01, 0), (12, 0.01, 1), (12, 0.005, 0)):
        voxels, seen = bunny_seen(mesh, num_views, voxel_m, bool(noise))
        stored = voxels.stored()
        name = f"{num_views} views, {voxel_m * 1000:g} mm{', noisy' if noise else ''}"
        ours = surface_mesh.surface(stored)
        spent = milliseconds(partial(surface_mesh.surface, stored), rounds)
        row = compare(ours.vertices_m, ours.faces, mesh, seen, voxel_m)
        print(f"{name:<36}{row}{spent:>8.0f}")
        print(
            f"{'  marching cubes of the classes':<36}{compare(*bare(stored), mesh, seen, voxel_m)}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    print(describe("numpy", "numba", "pyoctomap", "scikit-image", "trimesh"))
    files(args.rounds)
    surfaces(args.rounds)


if __name__ == "__main__":
    main()
