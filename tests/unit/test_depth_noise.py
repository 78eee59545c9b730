"""The noise against the formulas it claims, and its determinism."""

import subprocess
import sys

import numpy as np
import pytest

from services.kernels.depth_noise import (
    NGUYEN,
    RAW_INVALID,
    RAW_NO_RETURN,
    NoiseModel,
    NoisePool,
    add_noise,
    d4xx,
    drop_out,
    incidence_cosine,
    mesh_cosines,
    quantise,
)
from services.kernels.edge_jitter import jitter_edges, mark_edges

pytestmark = pytest.mark.unit

WIDTH, HEIGHT = 320, 240
FOCAL = 290.0
INTRINSICS = np.array([FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2])
SCALE_M = 0.0001  # fine, so that rounding does not drown the noise.
RANGES = (0.1, 5.0, SCALE_M)
IMAGES = 12
POOL = NoisePool()


def wall(z_m):
    return np.full((HEIGHT, WIDTH), z_m, np.float32), np.zeros((HEIGHT, WIDTH), np.int32)


def noisy(depth, model, cosine, tick=0, ranges=RANGES, jitter=False):
    """Report an image of a single face seen at the given cosine."""
    triangle = np.zeros(depth.shape, np.int32)
    raw = np.empty(depth.shape, np.uint16)
    draws = POOL.draw(depth.shape, 0.0, 7, 3, tick)
    cosines = np.array([cosine], np.float32)
    add_noise(depth, triangle, cosines, 1.0, INTRINSICS, ranges, model, draws, raw)
    if jitter:
        marks = np.empty(depth.shape, np.uint8)
        mark_edges(depth, marks)
        jitter_edges(depth, triangle, cosines, 1.0, INTRINSICS, ranges, model, draws, marks, raw)
    return raw


def measured_sigma_m(z_m, model, theta):
    depth, _ = wall(z_m)
    raw = np.stack([noisy(depth, model, np.cos(theta), tick) for tick in range(IMAGES)])
    assert (raw > 0).all()
    error = raw * SCALE_M - z_m
    assert abs(error.mean()) < 0.02 * error.std()
    return error.std()


@pytest.mark.parametrize("degrees", [0, 30, 60, 75, 79])
@pytest.mark.parametrize("z_m", [0.5, 1.1, 2.5])
def test_nguyens_sigma_is_what_a_wall_measures(z_m, degrees):
    theta = np.radians(degrees)
    axial = 0.0012 + 0.0019 * (z_m - 0.4) ** 2
    sigma = axial + 0.0001 / np.sqrt(z_m) * theta**2 / (np.pi / 2 - theta) ** 2
    assert measured_sigma_m(z_m, NGUYEN, theta) == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize("z_m", [0.5, 1.1, 2.5])
def test_a_stereo_cameras_sigma_grows_with_the_square_of_depth_only(z_m):
    sigma = z_m**2 * 0.1 / (FOCAL * 0.05)
    for degrees in (0, 60):
        measured = measured_sigma_m(z_m, d4xx(FOCAL), np.radians(degrees))
        assert measured == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize("degrees", [0, 79, 81, 84, 87, 89.9])
def test_surfaces_beyond_eighty_degrees_drop_out_surely_so_at_ninety(degrees):
    cosine = np.cos(np.radians(degrees))
    depth, _ = wall(1.0)
    lost = np.mean([noisy(depth, NGUYEN, cosine, tick) == RAW_INVALID for tick in range(4)])
    expected = max(0.0, 1.0 - cosine / np.cos(np.radians(80.0)))
    assert lost == pytest.approx(expected, abs=0.01)


def test_sigma_stops_growing_at_eighty_degrees():
    depth, _ = wall(1.0)

    def sigma(degrees):
        raw = noisy(depth, NGUYEN, np.cos(np.radians(degrees)))
        return np.std(raw[raw > 0] * SCALE_M)

    assert sigma(85) == pytest.approx(sigma(80), rel=0.05)


def test_nothing_in_range_is_no_return_and_too_near_is_invalid():
    depth = np.array([[np.inf, 5.01, 4.5, 1.0, 0.11, 0.09]], np.float32)
    expected = [RAW_NO_RETURN, RAW_NO_RETURN, 45000, 10000, 1100, RAW_INVALID]
    raw = np.empty(depth.shape, np.uint16)
    quantise(depth, *RANGES, raw)
    np.testing.assert_array_equal(raw[0], expected)
    np.testing.assert_array_equal(noisy(depth, NoiseModel(), 1.0)[0], expected)


@pytest.mark.parametrize("scale_m", [0.001, 0.0001, 0.00025])
def test_quantising_rounds_to_the_nearest_unit(scale_m):
    depth = np.random.default_rng(0).uniform(0.1, 5.0, (40, 50)).astype(np.float32)
    raw = np.empty(depth.shape, np.uint16)
    quantise(depth, 0.1, 5.0, scale_m, raw)
    assert np.abs(raw * scale_m - depth).max() <= scale_m * 0.51


def test_the_same_seed_camera_and_tick_give_the_same_image_and_others_do_not():
    depth, triangle = wall(1.0)

    def image(*key):
        raw = np.empty(depth.shape, np.uint16)
        draws = NoisePool().draw(depth.shape, 0.005, *key)
        cosines = np.ones(1, np.float32)
        add_noise(depth, triangle, cosines, 1.0, INTRINSICS, RANGES, NGUYEN, draws, raw)
        drop_out(draws.salt, raw)
        return raw

    once = image(1, 2, 3)
    np.testing.assert_array_equal(once, image(1, 2, 3))
    for other in [(2, 2, 3), (1, 1, 3), (1, 2, 4)]:
        correlation = np.corrcoef(once[once > 0][:70000], image(*other)[once > 0][:70000])[0, 1]
        assert abs(correlation) < 0.05


def test_another_process_draws_the_same_numbers():
    program = (
        "from services.kernels.depth_noise import NoisePool\n"
        "d = NoisePool().draw((48, 64), 0.005, 1, 2, 3)\n"
        "print(d.normal_starts.sum(), d.uniform_starts.sum(), d.salt.sum(), d.normals.sum())"
    )
    there = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    d = POOL.draw((48, 64), 0.005, 1, 2, 3)
    here = [d.normal_starts.sum(), d.uniform_starts.sum(), d.salt.sum(), d.normals.sum()]
    assert there.stdout.split() == [str(value).encode() for value in here]


def test_salt_is_the_asked_share_of_the_image():
    draws = POOL.draw((HEIGHT, WIDTH), 0.005, 1, 2, 3)
    raw = np.ones((HEIGHT, WIDTH), np.uint16)
    drop_out(draws.salt, raw)
    assert np.mean(raw == RAW_INVALID) == pytest.approx(0.005, rel=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_mesh_cosines_are_those_of_the_angle_between_normal_and_ray(seed):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(9, 3)) + [0, 0, 5]
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    cosines = np.empty(3, np.float32)
    mesh_cosines(vertices, faces, cosines)
    for corners, cosine in zip(vertices[faces], cosines, strict=True):
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        ray = corners.mean(axis=0)
        expected = -normal @ ray / np.linalg.norm(normal) / np.linalg.norm(ray)
        assert cosine == pytest.approx(expected, abs=1e-6)


def test_grounds_cosine_is_the_cameras_height_over_the_rays_length():
    none = np.empty(0, np.float32)
    z, u, v = 2.0, 30, 200
    ray = np.array([(u - INTRINSICS[2]) / FOCAL, (v - INTRINSICS[3]) / FOCAL, 1.0])
    cosine = incidence_cosine(np.float32(z), -1, none, 0.7, INTRINSICS, u, v)
    assert cosine == pytest.approx(0.7 / np.linalg.norm(z * ray), rel=1e-6)


def test_edges_are_found_at_jumps_and_not_on_slanted_planes():
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    slanted = (1.0 / (0.3 + 0.002 * u + 0.001 * v)).astype(np.float32)
    marks = np.full(slanted.shape, 9, np.uint8)
    mark_edges(slanted, marks)
    assert not marks.any()
    slanted[:, 100:] *= 1.05
    slanted[50:, 200:] = np.inf
    mark_edges(slanted, marks)
    expected = np.zeros(marks.shape, bool)
    expected[:, 99:101] = True
    expected[49:51, 200:] = True
    expected[50:, 199:201] = True
    np.testing.assert_array_equal(marks > 0, expected)


def test_edges_roll_as_often_as_the_lateral_sigma_says():
    """A step from 1 m to 2 m: column d left of it looks across iff round(sigma n) > d."""
    from math import erfc, sqrt

    depth, _ = wall(1.0)
    depth[:, WIDTH // 2 :] = 2.0
    model = NoiseModel(lateral_px=0.8)
    across = np.mean(
        [noisy(depth, model, 1.0, tick, jitter=True) == 20000 for tick in range(IMAGES)],
        axis=(0, 1),
    )
    for d in range(3):
        expected = erfc((d + 0.5) / 0.8 / sqrt(2)) / 2
        assert across[WIDTH // 2 - 1 - d] == pytest.approx(expected, abs=0.02)
        assert 1 - across[WIDTH // 2 + d] == pytest.approx(expected, abs=0.02)
    assert across[: WIDTH // 2 - 4].max() == 0
    assert across[WIDTH // 2 + 4 :].min() == 1
