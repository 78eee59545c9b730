"""The surface lies where the voxels were hit, faces free space, and is open where nobody looked."""

import numpy as np
import pytest
import trimesh

from services.kernels import nearby
from services.kernels.rigid import look_at
from services.mapper.box import Box
from services.mapper.errors import BadMapFile, MapTooLarge
from services.mapper.sensor_model import SensorModel
from services.mapper.stored_map import StoredMap
from services.mapper.surface_mesh import Mesh, mesh_bytes, surface
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

VOXEL_M, RADIUS_M, CENTRE_M = 0.01, 0.2, np.array([0.013, -0.006, 0.004])
PINHOLE, SHAPE = (290.0, 290.0, 159.5, 119.5), (240, 320)
SCALE_M = 0.0001


def directions(count: int) -> np.ndarray:
    """(N, 3) spread evenly over the sphere (Fibonacci)."""
    n = np.arange(count) + 0.5
    z, angle = 1 - 2 * n / count, np.pi * (1 + 5**0.5) * n
    level = np.sqrt(1 - z * z)
    return np.stack([level * np.cos(angle), level * np.sin(angle), z], axis=1)


def sphere_image(T: np.ndarray) -> np.ndarray:
    """The sphere's depth image, in SCALE_M; nothing else returns."""
    fx, fy, cx, cy = PINHOLE
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(SHAPE)], axis=-1)
    centre = T[:3, :3].T @ (CENTRE_M - T[:3, 3])
    b, squared = rays @ centre, (rays**2).sum(axis=-1)
    root = b * b - squared * (centre @ centre - RADIUS_M**2)
    depth = (b - np.sqrt(np.maximum(root, 0))) / squared
    return np.where(root > 0, np.round(depth / SCALE_M), 65535).astype(np.uint16)


def seen_from(eyes: np.ndarray, box_m: float = 0.32) -> StoredMap:
    voxels = VoxelMap(VOXEL_M, (-box_m,) * 3, (box_m,) * 3)
    for eye in eyes:
        T = look_at(CENTRE_M + 0.8 * eye, CENTRE_M)
        voxels.fuse_depth(sphere_image(T), PINHOLE, T, SCALE_M, 3.0)
    return voxels.stored()


@pytest.fixture(scope="module")
def sphere() -> StoredMap:
    return seen_from(directions(12))


def off_sphere(mesh: Mesh) -> np.ndarray:
    """Signed distances of the vertices to the sphere, voxels; outside is positive."""
    return (np.linalg.norm(mesh.vertices_m - CENTRE_M, axis=1) - RADIUS_M) / VOXEL_M


def outwardness(mesh: Mesh) -> np.ndarray:
    """Cosines between the faces' normals and the sphere's."""
    a, b, c = (mesh.vertices_m[mesh.faces[:, n]] for n in range(3))
    normal, radial = np.cross(b - a, c - a), (a + b + c) / 3 - CENTRE_M
    lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(radial, axis=1)
    return (normal * radial).sum(axis=1) / lengths


def test_a_sphere_seen_all_round_is_a_closed_sphere(sphere: StoredMap) -> None:
    mesh = surface(sphere)
    off = off_sphere(mesh)
    assert np.abs(off).max() < 1.0
    assert np.abs(off).mean() < 0.15
    assert abs(off.mean()) < 0.1
    solid = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.body_count == 1
    assert solid.volume == pytest.approx(4 / 3 * np.pi * RADIUS_M**3, rel=0.02)


def test_normals_point_to_free_space(sphere: StoredMap) -> None:
    cosines = outwardness(surface(sphere))
    assert (cosines > 0).all()
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean() < 8.0


def test_a_sphere_seen_from_one_side_is_open_on_the_other() -> None:
    eye = directions(12)[3]
    mesh = surface(seen_from(eye[None]))
    off = np.abs(off_sphere(mesh))
    assert np.quantile(off, 0.99) < 1.0
    assert off.max() < 1.5  # at the rim.
    assert (outwardness(mesh) > 0).mean() > 0.99
    along = (mesh.vertices_m - CENTRE_M) @ eye / RADIUS_M
    # From 0.8 m, the horizon lies at 1/4 of the radius.
    assert 0.1 < along.min() < 0.3
    assert not trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False).is_watertight


def plate(color: tuple[int, int, int] | None = None) -> StoredMap:
    """One layer of occupied voxels with free space on both sides."""
    box = Box(VOXEL_M, (-16, -16, -8), (4, 4, 2))
    dense = np.full(box.shape, -8000, np.int16)
    dense[4:28, 4:28, 7] = 8000
    blocks = dense.reshape(4, 8, 4, 8, 2, 8).transpose(0, 2, 4, 1, 3, 5).reshape(-1, 512)
    bricks = np.argwhere(np.ones(box.num_bricks)).astype(np.int16)
    colors = None
    if color is not None:
        colors = np.full((*blocks.shape, 3), 255, np.uint8)
        colors[blocks > 0] = color
    return StoredMap(box, SensorModel(), bricks, blocks, colors)


def test_what_is_one_voxel_thin_keeps_its_two_sides() -> None:
    mesh = surface(plate())
    inner = (np.abs(mesh.vertices_m[:, :2]) < 0.1).all(axis=1)
    np.testing.assert_allclose(mesh.vertices_m[inner, 2], -0.005, atol=0.5 * VOXEL_M)
    assert trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False).is_watertight
    assert np.ptp(mesh.vertices_m[:, 0]) == pytest.approx(0.24, abs=0.02)


def test_vertices_have_the_color_of_the_voxels_beside_them() -> None:
    mesh = surface(plate((200, 100, 50)))
    np.testing.assert_array_equal(mesh.color, [(200, 100, 50)] * len(mesh.vertices_m))
    assert surface(plate()).color is None


@pytest.mark.parametrize("kind", ["ply", "obj", "glb"])
@pytest.mark.parametrize("color", [None, (200, 100, 50)])
def test_the_file_holds_the_surface(kind: str, color: tuple[int, int, int] | None) -> None:
    stored = plate(color)
    mesh = surface(stored)
    data = mesh_bytes(stored, kind)
    loaded = trimesh.load_mesh(trimesh.util.wrap_as_stream(data), file_type=kind, process=False)
    assert len(loaded.faces) == len(mesh.faces)
    np.testing.assert_allclose(
        loaded.bounds, [mesh.vertices_m.min(0), mesh.vertices_m.max(0)], atol=1e-5
    )
    assert {"ply": b"property float nx", "obj": b"\nvn ", "glb": b"NORMAL"}[kind] in data
    if color is not None:
        assert (loaded.visual.vertex_colors[:, :3] == color).all()


def test_moments_and_colors_of_what_is_near_are_those_of_numpy() -> None:
    rng, reach = np.random.default_rng(5), 1.75
    number = np.full((6, 7, 8), -1, np.int32)
    there = rng.random(number.shape) < 0.2
    number[there] = rng.permutation(there.sum())
    color = rng.integers(0, 256, (there.sum(), 3)).astype(np.uint8)
    color[rng.random(len(color)) < 0.5] = 255
    points = rng.uniform(-2, 9, (500, 3))
    count, mean, second = np.empty(500, np.int32), np.empty((500, 3)), np.empty((500, 3, 3))
    colors = np.empty((500, 3), np.uint8)
    nearby.near_moments(points, number, reach, count, mean, second)
    nearby.near_colors(points, number, reach, color, 255, colors)
    for n, point in enumerate(points):
        off = np.argwhere(there) - point
        squared = (off**2).sum(axis=1) / reach**2
        near = squared < 1
        weight = np.exp(-4 * squared[near])
        assert count[n] == near.sum()
        if near.any():
            np.testing.assert_allclose(mean[n], np.average(off[near], axis=0, weights=weight))
            spread = np.atleast_2d(np.cov(off[near].T, aweights=weight, ddof=0))
            np.testing.assert_allclose(second[n], spread, atol=1e-9)
        rgb = color[number[there][near]]
        colored = (rgb != 255).any(axis=1)
        expected = np.full(3, 255.0)
        if colored.any():
            expected = np.average(rgb[colored], axis=0, weights=weight[colored])
        np.testing.assert_allclose(colors[n], expected, atol=0.5 + 1e-6)


def test_a_map_without_a_surface_says_so() -> None:
    empty = VoxelMap(VOXEL_M, (0, 0, 0), (1, 1, 1))
    with pytest.raises(BadMapFile, match="no occupied voxel, so"):
        surface(empty.stored())
    bricks = np.int16([[0, 0, 0]])
    for log_odds in (np.full((1, 512), 8000), np.r_[np.full(511, -32768), 8000][None]):
        with pytest.raises(BadMapFile, match="no occupied voxel faces free space"):
            surface(
                StoredMap(
                    Box(0.1, (0, 0, 0), (1, 1, 1)), SensorModel(), bricks, log_odds.astype(np.int16)
                )
            )


def test_two_voxels_far_apart_are_refused_with_the_number_of_voxels_between() -> None:
    box = Box(0.01, (0, 0, 0), (120, 120, 120))
    bricks = np.int16([[0, 0, 0], [119, 119, 119]])
    log_odds = np.full((2, 512), 8000, np.int16)
    with pytest.raises(MapTooLarge, match=r"9.*e\+08 in all"):
        surface(StoredMap(box, SensorModel(), bricks, log_odds))
