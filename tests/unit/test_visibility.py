"""What cameras see of a sphere is known in closed form."""

import math

import numpy as np
import pytest

from schemas.camera import Intrinsics
from services.evaluator.samples import place, sample
from services.evaluator.surface import Surface
from services.evaluator.views import View, admissible_eyes, eyes
from services.evaluator.visibility import MAX_INCIDENCE_RAD, in_frustum, observable, visibility
from services.kernels.rigid import look_at
from services.world.mesh import load_mesh
from tests.raycast_reference import RayCaster

pytestmark = pytest.mark.unit

RADIUS_M = 0.2
CENTRE_M = np.array([0, 0, RADIUS_M])
OPTICS = Intrinsics.from_vertical_fov(640, 480, math.radians(45))
# A facet of the mesh is tilted by up to 2.5 degrees against the sphere it approximates.
FACET_RAD = math.radians(3)


@pytest.fixture(scope="module")
def sphere():
    mesh = load_mesh("sphere", height_m=2 * RADIUS_M)
    surface = Surface(mesh.vertices_m, mesh.faces)
    return surface, place(sample(surface, 4000, seed=0), surface)


def view_from(eye_m, at_m=CENTRE_M, optics=OPTICS, min_range_m=0.05, max_range_m=5.0):
    return View(look_at(eye_m, at_m), optics, min_range_m, max_range_m)


def random_eyes(num, seed):
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(num, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return CENTRE_M + directions * rng.uniform(0.6, 2.0, size=(num, 1))


def polar_angle(placed, eye_m):
    """Angle at the sphere's centre between each sample and the eye."""
    out = placed.points_m - CENTRE_M
    axis = (eye_m - CENTRE_M) / np.linalg.norm(eye_m - CENTRE_M)
    return np.arccos(np.clip(out @ axis / np.linalg.norm(out, axis=1), -1, 1))


@pytest.mark.parametrize("eye_m", random_eyes(6, seed=1))
def test_one_camera_sees_the_cap_below_its_tangent_cone(sphere, eye_m):
    surface, placed = sphere
    cap_rad = math.acos(RADIUS_M / np.linalg.norm(eye_m - CENTRE_M))
    angle = polar_angle(placed, eye_m)
    seen = visibility(surface, placed, [view_from(eye_m)]).best_cosine > 0
    assert np.all(seen[angle < cap_rad - FACET_RAD])
    assert not np.any(seen[angle > cap_rad + FACET_RAD])
    # A cap of half-angle a holds (1 - cos a) / 2 of the sphere.
    assert seen.mean() == pytest.approx((1 - math.cos(cap_rad)) / 2, abs=0.01)


@pytest.mark.parametrize("eye_m", random_eyes(4, seed=2))
def test_the_incidence_is_that_of_the_triangle_eye_sample_centre(sphere, eye_m):
    surface, placed = sphere
    sight = visibility(surface, placed, [view_from(eye_m)])
    distance = np.linalg.norm(eye_m - CENTRE_M)
    cosine = np.cos(polar_angle(placed, eye_m))
    expected = (distance * cosine - RADIUS_M) / np.sqrt(
        distance**2 + RADIUS_M**2 - 2 * distance * RADIUS_M * cosine
    )
    seen = sight.best_cosine > 0.1
    assert np.allclose(sight.best_cosine[seen], expected[seen], atol=math.sin(FACET_RAD))


def test_a_set_of_cameras_sees_what_each_sees_and_nothing_else(sphere):
    surface, placed = sphere
    views = [view_from(eye_m) for eye_m in random_eyes(5, seed=3)]
    together = visibility(surface, placed, views)
    alone = [visibility(surface, placed, [view]) for view in views]
    assert np.allclose(together.best_cosine, np.max([a.best_cosine for a in alone], axis=0))
    assert np.array_equal(together.in_view, np.any([a.in_view for a in alone], axis=0))


def test_a_body_hides_what_stands_behind_it():
    mesh = load_mesh("sphere", height_m=2 * RADIUS_M)
    gap = np.array([1, 0, 0], np.float32)
    vertices = np.concatenate([mesh.vertices_m, mesh.vertices_m * 0.4 - gap])
    surface = Surface(vertices, np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices_m)]))
    placed = place(sample(surface, 3000, seed=0), surface)
    small = placed.points_m[:, 0] < -0.5
    # From the far end of the line through both, the big sphere covers the small one wholly.
    ahead = visibility(surface, placed, [view_from((2.0, 0, 0.2))])
    aside = visibility(surface, placed, [view_from((-1.0, 2.0, 0.2), (-1, 0, 0.1))])
    assert not np.any(ahead.best_cosine[small] > 0)
    assert np.all(ahead.in_view[small])
    assert np.mean(aside.best_cosine[small] > 0) > 0.4


@pytest.mark.parametrize("azimuth_deg", [0, 70, 200])
def test_what_is_seen_of_the_bunny_is_what_its_depth_image_shows(azimuth_deg):
    mesh = load_mesh("bunny", height_m=0.4, subdivide=2)
    surface = Surface(mesh.vertices_m, mesh.faces)
    placed = place(sample(surface, 4000, seed=0), surface)
    azimuth = math.radians(azimuth_deg)
    view = view_from((math.cos(azimuth), math.sin(azimuth), 0.5))
    T, k = view.T_target_camera, view.intrinsics
    image = RayCaster(mesh.vertices_m, mesh.faces).depth_m(
        T, (k.fx, k.fy, k.cx, k.cy), k.width, k.height
    )
    x, y, z = ((placed.points_m - T[:3, 3]) @ T[:3, :3]).T
    row, column = np.rint(k.fy * y / z + k.cy), np.rint(k.fx * x / z + k.cx)
    shown = z < image[row.astype(int), column.astype(int)] + 2e-3
    sight = visibility(surface, placed, [view])
    # A pixel is 1.7 mm wide: at contours and on slopes its depth is not the sample's.
    assert np.mean(sight.seen(math.radians(70)) & ~shown) < 0.003
    assert np.mean(shown & (sight.best_cosine == 0)) < 0.02


def test_no_camera_or_one_that_looks_away_sees_nothing(sphere):
    surface, placed = sphere
    for views in ([], [view_from((1, 0, 0.2), at_m=(2, 0, 0.2))]):
        sight = visibility(surface, placed, views)
        assert not sight.in_view.any()
        assert not sight.seen().any()


def test_a_sample_is_in_the_frustum_iff_its_pixel_is_on_the_image_and_its_depth_in_range():
    rng = np.random.default_rng(4)
    view = view_from((1.1, 0.3, 0.7), min_range_m=0.3, max_range_m=1.4)
    u, v = rng.uniform(-200, 840, 2000), rng.uniform(-200, 680, 2000)
    z = rng.uniform(-1, 2, 2000)
    camera = np.stack([(u - OPTICS.cx) / OPTICS.fx * z, (v - OPTICS.cy) / OPTICS.fy * z, z], 1)
    T = view.T_target_camera
    points = (camera @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
    on_image = (u >= -0.5) & (u < 639.5) & (v >= -0.5) & (v < 479.5)
    expected = on_image & (z >= 0.3) & (z <= 1.4)
    # Float32 moves a pixel by less than 1e-3; none of these is that near to an edge.
    clear = np.minimum.reduce([abs(u + 0.5), abs(u - 639.5), abs(v + 0.5), abs(v - 479.5)]) > 1e-2
    clear &= np.minimum.reduce([abs(z), abs(z - 0.3), abs(z - 1.4)]) > 1e-4
    assert np.array_equal(in_frustum(points, view)[clear], expected[clear])


def test_admissible_eyes_fill_their_band_of_the_sphere_evenly():
    centre = np.array([0.1, -0.2, 0.3])
    out = admissible_eyes(centre, 1.1, (math.radians(5), math.radians(80)), num=400) - centre
    assert np.allclose(np.linalg.norm(out, axis=1), 1.1, atol=1e-5)
    elevation = np.degrees(np.arcsin(out[:, 2] / 1.1))
    assert 5 <= elevation.min() < 6
    assert 75 < elevation.max() <= 80
    directions = out / 1.1
    nearest = np.sort(np.arccos(np.clip(directions @ directions.T, -1, 1)), axis=1)[:, 1]
    assert np.degrees(nearest.min()) > 3


def test_of_a_sphere_all_is_observable_down_to_the_lowest_views_horizon(sphere):
    surface, placed = sphere
    distance, lowest = 1.1, math.radians(5)
    seen = observable(surface, placed, admissible_eyes(CENTRE_M, distance))
    # The law of sines gives how far from the view's axis the incidence reaches its limit.
    reach = MAX_INCIDENCE_RAD - math.asin(RADIUS_M / distance * math.sin(MAX_INCIDENCE_RAD))
    elevation = np.arcsin(np.clip((placed.points_m[:, 2] - RADIUS_M) / RADIUS_M, -1, 1))
    spacing = math.radians(4)
    assert np.all(seen[elevation > lowest - reach + FACET_RAD + spacing])
    assert not np.any(seen[elevation < lowest - reach - FACET_RAD])


def test_observable_is_what_some_view_sees(sphere):
    surface, placed = sphere
    views = [view_from(eye_m) for eye_m in random_eyes(40, seed=6)]
    expected = visibility(surface, placed, views).seen()
    assert np.array_equal(observable(surface, placed, eyes(views)), expected)
