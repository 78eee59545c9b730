"""From light to pictures: means, gamma, edges, and pictures within pictures."""

import numpy as np
import pytest

from services.kernels import screen
from services.kernels.palette import MAGMA, VIRIDIS, colours, linear
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import apply, inverse, look_at

pytestmark = pytest.mark.unit


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_a_picture_is_the_mean_light_in_srgb(rng):
    rgb = rng.uniform(-0.1, 1.2, (12, 18, 3)).astype(np.float32)
    picture = np.empty((4, 6, 3), np.uint8)
    screen.develop(rgb, 3, screen.gamma_table(), picture)
    mean = rgb.clip(0, 1).astype(float).reshape(4, 3, 6, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(linear(picture / 255), mean, atol=4e-3)


def test_gamma_undoes_linear():
    told = np.arange(256)
    rgb = np.repeat(linear(told / 255)[None, :, None], 3, axis=2).astype(np.float32)
    picture = np.empty((1, 256, 3), np.uint8)
    screen.develop(rgb, 1, screen.gamma_table(), picture)
    assert np.abs(picture[0, :, 0].astype(int) - told).max() <= 1


@pytest.mark.parametrize(("name", "palette"), [("viridis", VIRIDIS), ("magma", MAGMA)])
def test_palettes_are_matplotlibs(name, palette):
    matplotlib = pytest.importorskip("matplotlib")
    table = matplotlib.colormaps[name](np.arange(256))[:, :3]
    np.testing.assert_allclose(colours(palette, np.arange(256) / 255), table, atol=0.02)
    np.testing.assert_array_equal(colours(palette, [-3, 7]), colours(palette, [0, 1]))


def test_brightness_of_a_palette_rises_all_the_way():
    """So it can be read without seeing colours at all."""
    for palette in (VIRIDIS, MAGMA):
        light = linear(colours(palette, np.linspace(0, 1, 100))) @ (0.2126, 0.7152, 0.0722)
        assert (np.diff(light) > -1e-4).all()


def test_only_pixels_that_stand_out_are_darkened():
    depth = np.full((9, 9), 2.0, np.float32)
    depth[3:6, 3:6] = 1.0
    rgb, triangle = np.ones((9, 9, 3), np.float32), np.zeros((9, 9), np.int32)
    screen.outline(rgb, depth, triangle, 0.5, 1, 0.6)
    dark = np.zeros((9, 9), bool)
    dark[3:6, 3:6] = True
    dark[4, 4] = False
    np.testing.assert_allclose(rgb[..., 0], np.where(dark, 0.6, 1.0), atol=1e-6)


def test_a_veil_covers_what_the_triangles_do(rng):
    rgb = rng.random((5, 6, 3)).astype(np.float32)
    triangle = rng.integers(-1, 2, (5, 6)).astype(np.int32)
    colour = np.array([0.2, 0.4, 0.9])
    expected = np.where((triangle >= 0)[..., None], 0.7 * rgb + 0.3 * colour, rgb)
    screen.veil(rgb, triangle, colour, 0.3)
    np.testing.assert_allclose(rgb, expected, atol=1e-6)


def test_a_hung_pictures_pixel_is_where_its_camera_has_it():
    """A point on the image plane shows what the other camera's K says of it."""
    other = look_at((1.0, 0.5, 0.6), (0, 0, 0.2))
    K = np.array([20.0, 20.0, 7.5, 5.5])
    image = np.random.default_rng(0).random((12, 16, 3)).astype(np.float32)
    u, v = np.array([-0.5, 15.5, 15.5, -0.5]), np.array([-0.5, -0.5, 11.5, 11.5])
    plane = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones(4)], axis=1) * 0.3
    eye = look_at((-0.2, -0.6, 0.9), other[:3, 3])
    lens = np.array([150.0, 150.0, 79.5, 59.5])
    seen = np.empty((4, 3))
    to_camera(apply(other, plane), eye, seen)
    depth = np.full((120, 160), np.inf, np.float32)
    triangle = np.full((120, 160), -1, np.int32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]], np.int32)
    rasterise(seen, faces, lens, 0.01, depth, triangle)
    rgb = np.zeros((120, 160, 3), np.float32)
    screen.hang(rgb, depth, triangle, image, eye, lens, inverse(other), K, 1.0)
    num = 0
    for j in range(12):
        for i in range(16):
            ray = np.array([(i - K[2]) / K[0], (j - K[3]) / K[1], 1.0]) * 0.3
            x, y, z = apply(inverse(eye), apply(other, ray))
            p, q = round(lens[0] * x / z + lens[2]), round(lens[1] * y / z + lens[3])
            if 0 <= p < 160 and 0 <= q < 120:
                assert triangle[q, p] >= 0
                np.testing.assert_allclose(rgb[q, p], image[j, i], atol=1e-6)
                num += 1
    assert num > 100
    assert not rgb[triangle < 0].any()
