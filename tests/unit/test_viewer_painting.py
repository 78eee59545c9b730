"""The error painted on the truth: a sphere, of which the map has some and cameras see some."""

import math

import numpy as np
import pytest

from schemas.camera import Intrinsics
from services.kernels.rigid import look_at
from services.viewer.painting import MAPPED, MISSED, OCCLUDED, View, paint
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

SIZE_M = 0.02
CENTRE_M = np.array([0.0, 0.0, 0.3])
OPTICS = Intrinsics.from_vertical_fov(640, 480, math.radians(45))


@pytest.fixture(scope="module")
def sphere():
    mesh = load_mesh("sphere", 0.6)
    return mesh.vertices_m, mesh.faces


def middles(sphere):
    vertices, faces = sphere
    return vertices[faces].mean(axis=1)


def shell(part=lambda points: np.ones(len(points), bool)):
    """Centres of the voxels that the sphere's surface passes, of the wanted part."""
    grid = np.stack(np.meshgrid(*[np.arange(-20, 20)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    centres = (grid + 0.5) * SIZE_M
    near = np.abs(np.linalg.norm(centres, axis=1) - 0.3) < SIZE_M / 2
    return centres[near & part(centres)] + CENTRE_M


def view(eye):
    return View(look_at(eye, CENTRE_M), OPTICS)


def test_a_perfect_map_leaves_nothing_missing_and_no_ghosts(sphere):
    classes, ghosts = paint(*sphere, shell(), SIZE_M, [])
    assert (classes == MAPPED).all()
    assert not ghosts.any()


def test_an_empty_map_misses_what_is_seen_and_the_rest_is_occluded(sphere):
    classes, ghosts = paint(*sphere, np.empty((0, 3)), SIZE_M, [view((1.5, 0.0, 0.3))])
    assert len(ghosts) == 0
    assert MAPPED not in classes
    # A camera at 1.5 m sees a cap of the sphere: x > r^2 / 1.5.
    x = middles(sphere)[:, 0]
    horizon = 0.3**2 / 1.5
    assert (classes[x > horizon + 0.04] == MISSED).all()
    assert (classes[x < horizon - 0.005] == OCCLUDED).all()


def test_two_cameras_see_what_either_sees(sphere):
    views = [view((1.5, 0.0, 0.3)), view((-1.5, 0.2, 0.4))]
    nothing = np.empty((0, 3))
    one, other, both = (
        paint(*sphere, nothing, SIZE_M, some)[0] == MISSED for some in (views[:1], views[1:], views)
    )
    np.testing.assert_array_equal(both, one | other)
    assert not np.array_equal(one, both)


def test_half_a_map_is_mapped_where_it_is(sphere):
    half = shell(lambda points: points[:, 2] > 0)
    classes, ghosts = paint(*sphere, half, SIZE_M, [])
    z = middles(sphere)[:, 2] - CENTRE_M[2]
    assert (classes[z > 0.01] == MAPPED).all()
    assert (classes[z < -2 * SIZE_M - 0.02] == OCCLUDED).all()
    assert not ghosts.any()


def test_voxels_away_from_the_surface_are_ghosts(sphere):
    away = CENTRE_M + np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.15, 0.1]])
    _, ghosts = paint(*sphere, np.concatenate([shell(), away]), SIZE_M, [])
    assert ghosts[-3:].all()
    assert not ghosts[:-3].any()


def test_a_camera_that_looks_away_sees_nothing(sphere):
    away = View(look_at((1.5, 0.0, 0.3), (3.0, 0.0, 0.3)), OPTICS)
    classes, _ = paint(*sphere, np.empty((0, 3)), SIZE_M, [away])
    assert (classes == OCCLUDED).all()
