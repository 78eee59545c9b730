"""Tables of extremes and windows of a depth image, against numpy."""

import numpy as np
import pytest

from services.kernels import cull, levels
from services.kernels.levels import PAD
from services.mapper.sight import Sight, windows

pytestmark = pytest.mark.unit

SHAPES = [(40, 56), (37, 51), (9, 70), (1, 5), (2, 1)]
LIMIT = np.uint16(40000)


def image_of(shape: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(5).integers(0, 65536, shape).astype(np.uint16)


def halved(image: np.ndarray) -> np.ndarray:
    """Numpy twin: the farthest of each 2x2 pixels, an odd edge repeated."""
    rows, columns = (-(-side // 2) for side in image.shape)
    edge = [(0, 2 * rows - image.shape[0]), (0, 2 * columns - image.shape[1])]
    blocks = np.pad(image, edge, mode="edge").reshape(rows, 2, columns, 2)
    return np.minimum(blocks.max(axis=(1, 3)), LIMIT)


def looking(image: np.ndarray) -> Sight:
    sight = Sight(*image.shape)
    for picture in (np.full_like(image, 65535), image):  # Nothing of an older image may stay.
        sight.look(picture, LIMIT)
    return sight


@pytest.mark.parametrize("shape", SHAPES)
def test_tables_hold_the_extremes_of_squares_of_cells(shape: tuple[int, int]) -> None:
    image = image_of(shape)
    left, maxima = looking(image).tables()
    half = halved(image)
    for level in range(levels.NUM_DOUBLINGS):
        for v, u in np.ndindex(half.shape):
            square = half[v : v + 2**level, u : u + 2**level]
            assert maxima[level, v + PAD, u + PAD] == square.max()
            assert levels.MOST - left[level, v + PAD, u + PAD] == square.min()


@pytest.mark.parametrize("shape", [(40, 56), (37, 301)])
def test_extremes_of_rectangles_are_those_of_numpy(shape: tuple[int, int]) -> None:
    rng, image = np.random.default_rng(6), image_of(shape)
    left, maxima = looking(image).tables()
    half = halved(image)
    for _ in range(500):
        (a0, a1), (b0, b1) = (np.sort(rng.integers(0, side, 2)) for side in half.shape)
        corners = (a0 + PAD, a1 + PAD, b0 + PAD, b1 + PAD)
        assert cull.farthest_in(maxima, *corners) == half[a0 : a1 + 1, b0 : b1 + 1].max()
        assert cull.nearest_in(left, *corners) == half[a0 : a1 + 1, b0 : b1 + 1].min()


def assert_reaches(
    plane: np.ndarray, reach: np.ndarray, size: tuple[int, int], back: tuple[int, int], rim: int
) -> None:
    """Each entry is the farthest in the window that begins `back` before it, also at the rim."""
    padded = np.pad(reach, rim + 40)
    windows = np.lib.stride_tricks.sliding_window_view(padded, size).max(axis=(2, 3))
    rows, columns = (slice(40 - b, 40 - b + n) for b, n in zip(back, plane.shape, strict=True))
    np.testing.assert_array_equal(plane, windows[rows, columns])


@pytest.mark.parametrize("aspect", [1.0, 1.3, 0.76])
@pytest.mark.parametrize("shape", SHAPES)
def test_windows_of_every_level_reach_as_far_as_their_farthest_pixel(
    shape: tuple[int, int], aspect: float
) -> None:
    image = image_of(shape)
    everywhere = (-levels.PAD, shape[0] + levels.PAD, -levels.PAD, shape[1] + levels.PAD)
    sights = looking(image).levels(
        np.tile(np.int32(everywhere), (levels.NUM_LEVELS, 1)), windows(aspect)
    )
    reach, half = np.minimum(image, LIMIT), halved(image)
    fine = sights.fine.reshape(-1, *sights.fine_shape)
    for plane in range(levels.NUM_EXACT):
        size = (1 + plane // 2, 1 + plane % 2)
        assert_reaches(fine[plane], reach, size, (0, 0), levels.RIM_PX)
    for level in range(1, levels.NUM_FINE):
        down, right = sights.windows[level]
        plane = fine[levels.NUM_EXACT + level - 1]
        assert_reaches(plane, reach, (down, right), (down // 2, right // 2), levels.RIM_PX)
    coarse = sights.coarse.reshape(-1, *sights.coarse_shape)
    for level, plane in enumerate(coarse, start=levels.NUM_FINE):
        down, right = sights.windows[level]
        assert_reaches(plane, half, (down, right), (down // 2, right // 2), levels.RIM_CELLS)


@pytest.mark.parametrize("aspect", [1.0, 1.3, 0.76])
def test_windows_are_as_wide_as_asked_and_fit_their_planes(aspect: float) -> None:
    down, right = windows(aspect).T
    mean = np.concatenate([np.arange(1, levels.NUM_FINE + 1), levels.WIDTHS])
    bounded = np.concatenate([np.arange(levels.NUM_FINE) < 3, levels.WIDTHS < 24])
    assert (np.abs(right - mean * aspect) <= 2.5)[bounded].all()
    assert (np.abs(down - mean / aspect) <= 2.5)[bounded].all()
    assert max(down.max(), right.max()) <= levels.WIDTHS[-1]


def test_the_level_asked_for_has_the_window_closest_in_width() -> None:
    widths = np.concatenate([np.arange(1, levels.NUM_FINE + 1), 2 * levels.WIDTHS])
    for pixels in np.linspace(2.0, 80, 500):
        level = int(levels.level_for(np.float32(pixels)))
        assert abs(widths[level] - pixels) <= np.abs(widths - pixels).min() + 1e-4
    assert {int(levels.level_for(np.float32(px))) for px in (0.1, 1.0, 1.99)} == {levels.EXACT}
