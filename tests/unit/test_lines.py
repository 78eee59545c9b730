"""Laws of lines: they are where they are projected, as wide as asked, and behind what is before."""

import numpy as np
import pytest

from services.kernels.lines import draw_lines

pytestmark = pytest.mark.unit

K = np.array([90.0, 90.0, 49.5, 39.5])
WIDTH, HEIGHT, NEAR_M = 100, 80, 0.1


def drawn(ends, width_px=3.0, alpha=1.0, depth=np.inf, hidden=0.25, slack_m=0.0):
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    depth_m = np.full((HEIGHT, WIDTH), depth, np.float32)
    ends = np.asarray(ends, float).reshape(-1, 2, 3)
    rgba = np.tile([1.0, 0.5, 0.0, alpha], (len(ends), 1))
    widths = np.full(len(ends), width_px)
    draw_lines(rgb, depth_m, ends, rgba, widths, K, NEAR_M, slack_m, hidden)
    return rgb


def projected(point):
    x, y, z = point
    return np.array([K[0] * x / z + K[2], K[1] * y / z + K[3]])


def coverage(ends, width_px):
    """What each pixel's centre gets, by distances to the projected segment."""
    a, b = (projected(end) for end in ends)
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1)
    t = np.clip((pixels - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    away = np.linalg.norm(pixels - a - t[..., None] * (b - a), axis=-1)
    return np.clip(width_px / 2 + 0.5 - away, 0, 1)


def test_a_line_covers_what_lies_near_its_projection():
    rng = np.random.default_rng(1)
    for _ in range(40):
        ends = rng.uniform((-0.8, -0.6, 0.5), (0.8, 0.6, 2.0), (2, 3))
        width_px = rng.uniform(0.5, 6)
        rgb = drawn(ends, width_px)
        np.testing.assert_allclose(rgb[..., 0], coverage(ends, width_px), atol=1e-5)
        np.testing.assert_allclose(rgb[..., 1], 0.5 * rgb[..., 0], atol=1e-6)


def test_a_line_behind_something_keeps_only_its_hidden_share():
    ends = [(-0.2, 0, 1.0), (0.2, 0, 1.0)]
    seen = drawn(ends)
    np.testing.assert_allclose(drawn(ends, depth=0.9), 0.25 * seen, atol=1e-6)
    np.testing.assert_array_equal(drawn(ends, depth=1.1), seen)
    np.testing.assert_array_equal(drawn(ends, depth=0.95, slack_m=0.1), seen)


def test_depth_along_a_line_is_that_of_its_points():
    """From 0.5 m to 2 m away, a wall at 1 m hides what is beyond the point at 1 m."""
    start, end = np.array([-0.2, 0.0, 0.5]), np.array([0.8, 0.0, 2.0])
    rgb = drawn([start, end], depth=1.0, hidden=0.0)
    meets = projected(start + (1.0 - 0.5) / 1.5 * (end - start))[0]
    columns = np.flatnonzero(rgb[39, :, 0] + rgb[40, :, 0])
    assert columns.max() == int(np.floor(meets))


def test_what_is_behind_the_camera_is_cut_off():
    whole = drawn([(0.0, 0.0, -1.0), (0.3, 0.2, 1.0)])
    s = (NEAR_M + 1.0) / 2.0
    cut = np.array([0.0, 0.0, -1.0]) + s * np.array([0.3, 0.2, 2.0])
    np.testing.assert_allclose(whole, drawn([cut, (0.3, 0.2, 1.0)]), atol=1e-5)
    assert not drawn([(0, 0, -1), (0.1, 0, -0.5)]).any()


def test_a_later_line_lies_over_an_earlier_one():
    ends = [[(-0.3, 0, 1), (0.3, 0, 1)]] * 2
    once, twice = drawn(ends[:1], alpha=0.5), drawn(ends, alpha=0.5)
    np.testing.assert_allclose(twice[..., 0], 1 - (1 - once[..., 0]) ** 2, atol=1e-6)
