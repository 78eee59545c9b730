"""The z-buffer against an independent ray caster, and its own laws."""

import numpy as np
import pytest

from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import apply, inverse, look_at, rotation_exp
from services.world.mesh import load_mesh
from tests.raycast_reference import RayCaster

pytestmark = pytest.mark.unit

WIDTH, HEIGHT = 320, 240
FOCAL = 290.0
INTRINSICS = np.array([FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2])
NEAR_M = 0.01

EYES = {
    "ring": (1.1, 0.0, 0.55),
    "close": (0.35, 0.3, 0.3),
    "low": (1.3, 0.2, 0.05),
    "above": (0.05, 0.02, 1.0),
    "far": (3.0, 1.0, 2.0),
    "touching": (0.3, -0.1, 0.05),
}


def draw(vertices_m, faces, T_world_camera, near_m=NEAR_M, intrinsics=INTRINSICS):
    seen = np.empty((len(vertices_m), 3))
    to_camera(np.asarray(vertices_m), T_world_camera, seen)
    depth = np.full((HEIGHT, WIDTH), np.inf, np.float32)
    triangle = np.full((HEIGHT, WIDTH), -1, np.int32)
    rasterise(seen, np.asarray(faces, np.int32), intrinsics, near_m, depth, triangle)
    return depth, triangle


def rolled(T, angle):
    out = T.copy()
    out[:3, :3] = T[:3, :3] @ rotation_exp([0, 0, angle])
    return out


@pytest.mark.parametrize("name", ["bunny", "sphere", "torus"])
@pytest.mark.parametrize("eye", EYES)
def test_depth_equals_the_ray_casters_to_a_tenth_of_a_millimetre(name, eye):
    mesh = load_mesh(name)
    T = rolled(look_at(EYES[eye], (0.0, 0.0, 0.2)), 0.3)
    depth, triangle = draw(mesh.vertices_m, mesh.faces, T)
    truth = RayCaster(mesh.vertices_m, mesh.faces).depth_m(T, INTRINSICS, WIDTH, HEIGHT)
    ours, theirs = np.isfinite(depth), np.isfinite(truth)
    assert theirs.sum() > 300
    np.testing.assert_array_equal(ours, triangle >= 0)
    assert (ours != theirs).sum() <= 0.001 * theirs.sum()
    both = ours & theirs
    np.testing.assert_allclose(depth[both], truth[both], rtol=0, atol=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_triangles_across_the_near_plane_are_cut_and_not_dropped(seed):
    """A camera above a large floor made of two triangles, one corner of each behind it."""
    rng = np.random.default_rng(seed)
    floor = np.array([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]], np.float64)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    ahead = rng.normal(size=2)
    T = look_at((0.0, 0.0, 1.0), (*ahead, 0.4))
    depth, _ = draw(floor, faces, T)
    truth = RayCaster(floor, faces).depth_m(T, INTRINSICS, WIDTH, HEIGHT)
    assert (np.isfinite(depth) != np.isfinite(truth)).sum() <= WIDTH  # the horizon's pixels.
    near = truth < 20.0
    assert near.sum() > 5000
    np.testing.assert_allclose(depth[near], truth[near], rtol=1e-5)


def test_what_is_nearer_than_the_near_plane_is_cut_away():
    wall = np.array([[-1, -1, 0], [1, -1, 0], [0, 2, 0]], np.float64)
    T = look_at((0.0, 0.0, 0.5), (0.0, 0.3, 0.0))  # depth varies over the wall.
    depth, _ = draw(wall, [[0, 1, 2]], T)
    cut, _ = draw(wall, [[0, 1, 2]], T, near_m=0.5)
    assert 0 < np.isfinite(cut).sum() < np.isfinite(depth).sum()
    np.testing.assert_allclose(cut, np.where(depth >= 0.5, depth, np.inf), rtol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_triangles_that_share_edges_cover_each_pixel_exactly_once(seed):
    """A fan about a point, corners often exactly on pixel centres and edges along rows."""
    rng = np.random.default_rng(seed)
    corners = np.array([[40, 30], [200, 30], [280, 120], [200, 210], [40, 210], [40, 120]])
    hub = rng.integers(100, 180, 2) + rng.choice([0.0, 0.5, 0.123], 2)
    uv = np.vstack([hub, corners]).astype(np.float64)
    rays = np.column_stack([(uv - INTRINSICS[2:]) / FOCAL, np.ones(len(uv))])
    covered = np.zeros((HEIGHT, WIDTH), int)
    for k in range(len(corners)):
        a, b = 1 + k, 1 + (k + 1) % len(corners)
        depth, _ = draw(rays, [[0, b, a]], np.eye(4))
        covered += np.isfinite(depth)
    inside = np.zeros_like(covered, dtype=bool)
    inside[31:210, 41:200] = True
    assert covered.max() == 1
    assert covered[inside].min() == 1


@pytest.mark.parametrize("seed", range(5))
def test_back_faces_are_not_drawn(seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(3, 3)) * 0.2 + [0, 0, 1.0]
    one, _ = draw(corners, [[0, 1, 2]], np.eye(4))
    other, _ = draw(corners, [[0, 2, 1]], np.eye(4))
    outward_z = np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ corners[0]
    front, back = (one, other) if outward_z < 0 else (other, one)
    assert np.isfinite(front).any()
    assert not np.isfinite(back).any()


def test_only_what_is_nearer_replaces_what_is_there():
    mesh = load_mesh("sphere")
    T = look_at(EYES["ring"], (0.0, 0.0, 0.2))
    alone, ids = draw(mesh.vertices_m, mesh.faces, T)
    before = np.full((HEIGHT, WIDTH), np.float32(np.median(alone[np.isfinite(alone)])))
    depth, triangle = before.copy(), np.full((HEIGHT, WIDTH), -1, np.int32)
    seen = apply(inverse(T), mesh.vertices_m)
    rasterise(seen, mesh.faces, INTRINSICS, NEAR_M, depth, triangle)
    np.testing.assert_array_equal(depth, np.minimum(alone, before))
    np.testing.assert_array_equal(triangle, np.where(alone < before, ids, -1))


def test_a_broken_mesh_draws_nothing_instead_of_crashing():
    corners = np.array([[np.nan, 0, 1], [np.inf, 0, 1], [0, 0.1, 1], [0.1, 0, 1]])
    depth, _ = draw(corners, [[0, 2, 3], [2, 1, 3], [2, 2, 2]], np.eye(4))
    assert not np.isfinite(depth).any()


@pytest.mark.parametrize("seed", range(3))
def test_to_camera_is_the_inverse_pose(seed):
    rng = np.random.default_rng(seed)
    T, points = look_at(*rng.normal(size=(2, 3))), rng.normal(size=(9, 3))
    seen = np.empty((9, 3))
    to_camera(points, T, seen)
    np.testing.assert_allclose(seen, apply(inverse(T), points), atol=1e-12)
