"""Laws of the colours."""

import numpy as np
import pytest

from services.kernels.ground import fill_ground
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import look_at
from services.kernels.shade import bake, noise_lattice, shade, vertex_normals
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

WIDTH, HEIGHT = 160, 120
INTRINSICS = np.array([145.0, 145.0, 79.5, 59.5])
LATTICE = noise_lattice(1)
UP = np.array([0.0, 0.0, 1.0])


def picture(mesh, T, light=UP, albedo=None, shift_m=(0, 0, 0)):
    vertices = (mesh.vertices_m + np.float32(shift_m)).astype(np.float32)
    seen = np.empty((len(vertices), 3))
    to_camera(vertices, T, seen)
    depth = np.empty((HEIGHT, WIDTH), np.float32)
    fill_ground(T, INTRINSICS, 0.01, 5.0, depth)
    triangle = np.full((HEIGHT, WIDTH), -1, np.int32)
    rasterise(seen, mesh.faces, INTRINSICS, 0.01, depth, triangle)
    normals = np.empty((len(vertices), 3))
    vertex_normals(vertices, mesh.faces, normals)
    if albedo is None:
        albedo = np.empty(len(vertices), np.float32)
        bake(mesh.vertices_m, LATTICE, albedo)
    bgr = np.empty((HEIGHT, WIDTH, 3), np.uint8)
    shade(
        depth, triangle, vertices, mesh.faces, normals, albedo, LATTICE, light, T, INTRINSICS, bgr
    )
    return bgr, depth, triangle


def test_normals_of_a_sphere_point_away_from_its_centre():
    mesh = load_mesh("sphere", height_m=0.4)
    normals = np.empty((len(mesh.vertices_m), 3))
    vertex_normals(mesh.vertices_m, mesh.faces, normals)
    outward = (mesh.vertices_m - [0, 0, 0.2]) / 0.2
    np.testing.assert_allclose(normals, outward, atol=0.02)


def test_a_plain_sphere_is_as_bright_as_lambert_says():
    mesh = load_mesh("sphere")
    light = np.array([0.6, 0.0, 0.8])
    T = look_at((1.0, 0.2, 0.5), (0, 0, 0.2))
    bgr, depth, triangle = picture(mesh, T, light, np.ones(len(mesh.vertices_m), np.float32))
    v, u = np.nonzero(triangle >= 0)
    fx, fy, cx, cy = INTRINSICS
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(len(u))], axis=1)
    points = (rays * depth[v, u, None]) @ T[:3, :3].T + T[:3, 3]
    lambert = np.maximum((points - [0, 0, 0.2]) @ light / 0.2, 0.0)
    np.testing.assert_allclose(bgr[v, u, 2], 240 * (0.4 + 0.6 * lambert), atol=4)


def test_the_texture_sticks_to_a_body_that_moves_with_the_camera():
    mesh = load_mesh("sphere")
    T = look_at((1.0, 0.2, 0.5), (0, 0, 0.2))
    there = T.copy()
    there[:3, 3] += [0.5, -0.25, 0.0]
    bgr, _, triangle = picture(mesh, T)
    moved, _, _ = picture(mesh, there, shift_m=(0.5, -0.25, 0.0))
    body = triangle >= 0
    assert bgr[body].std() > 20
    difference = np.abs(bgr[body].astype(int) - moved[body])
    assert np.percentile(difference, 99) <= 2


def test_sky_ground_and_body_are_told_apart_by_colour():
    bgr, depth, triangle = picture(load_mesh("bunny"), look_at((1.1, 0, 0.3), (0, 0, 0.3)))
    body, sky = triangle >= 0, np.isinf(depth)
    ground = ~body & ~sky
    assert (bgr[sky] == [235, 215, 200]).all()
    warm = bgr[..., 2].astype(int) - bgr[..., 0]
    assert warm[body].mean() > 20 > abs(warm[ground].mean())
