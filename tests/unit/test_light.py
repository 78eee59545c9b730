"""The lit picture: what is lit, what is in shadow, where floor and squares are."""

import numpy as np
import pytest

from services.kernels.light import Floor, Lamp, Mood, Squares, lit_share, paint
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import apply, inverse, look_at

pytestmark = pytest.mark.unit

WIDTH, HEIGHT = 120, 90
K = np.array([110.0, 110.0, 59.5, 44.5])
EYE = look_at((1.2, -0.9, 0.9), (0, 0, 0.1))
FLOOR = Floor(
    rgb=np.array([0.5, 0.6, 0.7]),
    line_rgb=np.array([0.1, 0.2, 0.3]),
    square_m=0.25,
    line_m=0.02,
    centre_m=np.zeros(2),
    fade_m=np.array([50.0, 60.0]),
)
MOOD = Mood(
    sun=0.6,
    sky=0.4,
    bounce=0.5,
    smooth=0.0,
    zenith_rgb=np.array([0.2, 0.3, 0.9]),
    horizon_rgb=np.array([0.8, 0.9, 1.0]),
)
CROWDED = np.array([1.0, 0.84, 0.70, 0.58])
NO_LIGHT = np.full((64, 64), np.inf, np.float32)


def lamp(depth=NO_LIGHT, soft_px=2, at=(0.0, 0.0, 9.0)):
    """Straight above unless asked; 64 pixels for 2 m at the ground."""
    size = len(depth)
    K_lamp = np.array([4.5 * size, 4.5 * size, (size - 1) / 2, (size - 1) / 2])
    return Lamp(inverse(look_at(at, (0, 0, 0))), K_lamp, depth, 0.01, soft_px)


def quads(corners, rgb, crowding=None):
    corners = np.asarray(corners, np.float32).reshape(-1, 4, 3)
    num = len(corners)
    crowding = np.zeros((num, 4), np.uint8) if crowding is None else np.asarray(crowding, np.uint8)
    rgb = np.broadcast_to(np.asarray(rgb, np.float32), (num, 3)).copy()
    return Squares(corners, np.zeros((num, 3), np.float32), rgb, crowding)


def painted(squares, the_lamp, floor=FLOOR, mood=MOOD):
    vertices = squares.corners_m.reshape(-1, 3)
    first = 4 * np.arange(len(squares.corners_m), dtype=np.int32)[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]], np.int32)).reshape(-1, 3)
    seen = np.empty((len(vertices), 3))
    to_camera(vertices, EYE, seen)
    depth = np.full((HEIGHT, WIDTH), np.inf, np.float32)
    triangle = np.full((HEIGHT, WIDTH), -1, np.int32)
    rasterise(seen, faces, K, 0.01, depth, triangle)
    rgb = np.empty((HEIGHT, WIDTH, 3), np.float32)
    paint(rgb, depth, triangle, squares, the_lamp, floor, mood, EYE, K)
    return rgb, depth, triangle


def pixel(point):
    x, y, z = apply(inverse(EYE), point)
    return round(K[1] * y / z + K[3]), round(K[0] * x / z + K[2])


def level(x, y, z, side=0.3):
    """A square that looks up, counter-clockwise from above."""
    return [(x, y, z), (x + side, y, z), (x + side, y + side, z), (x, y + side, z)]


def test_a_point_of_the_world_has_the_colour_that_light_gives_it():
    rgb, _, _ = painted(quads([level(-0.15, -0.15, 0.2)], (0.3, 0.5, 0.7)), lamp())
    np.testing.assert_allclose(rgb[pixel((0, 0, 0.2))], np.array([0.3, 0.5, 0.7]) * 1.0, atol=1e-5)


def test_what_is_in_front_hides_what_is_behind():
    toward_eye = EYE[:3, 3] / np.linalg.norm(EYE[:3, 3])
    middle = np.array([0, 0, 0.1]) + 0.3 * toward_eye
    near = level(middle[0] - 0.1, middle[1] - 0.1, middle[2], 0.2)
    far = level(-0.1, -0.1, 0.1, 0.2)
    for order in ([near, far], [far, near]):
        squares = quads(order, (0, 0, 0))
        squares.rgb[[order.index(near)]] = (1, 0, 0)
        rgb, _, triangle = painted(squares, lamp())
        at = pixel(middle)
        assert triangle[at] // 2 == order.index(near)
        assert rgb[at][0] > 0.9
        assert rgb[at][2] == 0


def test_the_floor_is_where_rays_meet_it():
    rgb, depth, _ = painted(quads([], (0, 0, 0)), lamp(soft_px=1))
    v, u = np.indices((HEIGHT, WIDTH))
    rays = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones(u.shape)], axis=-1)
    rays = rays @ EYE[:3, :3].T
    down = rays[..., 2] < -1e-6
    z = np.where(down, -EYE[2, 3] / np.where(down, rays[..., 2], -1), np.inf)
    hit = EYE[:2, 3] + np.where(down, z, 0)[..., None] * rays[..., :2]
    floor = down & (np.hypot(*np.moveaxis(hit, -1, 0)) < 50)
    np.testing.assert_allclose(depth[floor], z[floor], rtol=1e-5)
    # Far from any line, the floor has its own colour; on a crossing, its lines'.
    inside = floor & (np.abs(hit - 0.25 * np.round(hit / 0.25)).min(axis=-1) > 0.04)
    inside &= (np.abs(hit) < 0.6).all(axis=-1)
    assert inside.sum() > 100
    np.testing.assert_allclose(
        rgb[inside], np.broadcast_to(FLOOR.rgb, rgb[inside].shape), atol=1e-4
    )
    at = pixel((0.25, 0.25, 0.0))
    assert np.abs(rgb[at] - FLOOR.line_rgb).max() < np.abs(rgb[at] - FLOOR.rgb).max()
    assert np.isinf(depth[~down]).all()


def test_what_fades_has_the_backgrounds_colour():
    gone = FLOOR._replace(fade_m=np.array([0.1, 0.2]))
    rgb, depth, _ = painted(quads([], (0, 0, 0)), lamp(), floor=gone)
    up = 1 - np.arange(HEIGHT)[:, None] / HEIGHT
    background = MOOD.horizon_rgb + up * (MOOD.zenith_rgb - MOOD.horizon_rgb)
    far = np.isinf(depth)
    assert far.mean() > 0.5
    expected = np.broadcast_to(background[:, None], rgb.shape)
    np.testing.assert_allclose(rgb[far], expected[far], atol=1e-6)


def test_the_lit_share_is_the_mean_of_the_lamps_neighbourhood():
    """Against bilinear means of the lit/unlit image, written as a sum over sub-positions."""
    rng = np.random.default_rng(2)
    depth = np.where(rng.random((64, 64)) < 0.5, 8.0, 9.5).astype(np.float32)
    light = lamp(depth, soft_px=2)
    lit = (depth + light.slack_m >= 9.0).astype(float)
    num = 0
    for x, y in rng.uniform(-0.7, 0.7, (200, 2)):
        px, py, pz = apply(light.T_lamp_world, (x, y, 0.0))
        u = light.intrinsics[0] * px / pz + light.intrinsics[2]
        v = light.intrinsics[1] * py / pz + light.intrinsics[3]
        i, j, du, dv = int(u), int(v), u - int(u), v - int(v)
        window = lit[j - 2 : j + 4, i - 2 : i + 4]
        if window[[0, 2, 5]][:, [0, 2, 5]].sum() in (0, 9):
            continue  # All probes agree: taken as all lit, or none.
        across = np.array([1 - du, 1, 1, 1, 1, du])
        along = np.array([1 - dv, 1, 1, 1, 1, dv])
        np.testing.assert_allclose(lit_share(light, x, y, 0.0), along @ window @ across / 25)
        num += 1
    assert num > 150


def test_below_a_roof_it_is_dark_and_beside_it_light():
    depth = np.full((64, 64), np.inf, np.float32)
    depth[24:40, 24:40] = 8.5  # A roof half a metre high over the middle.
    rgb, _, _ = painted(quads([], (0, 0, 0)), lamp(depth))
    beside, below = rgb[pixel((0.6, 0.1, 0))], rgb[pixel((0.1, 0.1, 0))]
    np.testing.assert_allclose(beside, FLOOR.rgb, atol=1e-4)
    np.testing.assert_allclose(below, 0.4 * FLOOR.rgb, atol=1e-4)


def test_light_falls_off_with_the_cosine():
    tilt = np.radians(50)
    above = lamp(at=(9 * np.sin(tilt), 0, 9 * np.cos(tilt)))
    rgb, _, _ = painted(quads([level(-0.15, -0.15, 0.2)], (1, 1, 1)), above)
    np.testing.assert_allclose(rgb[pixel((0, 0, 0.2))], 0.4 + 0.6 * np.cos(tilt), atol=1e-5)


def test_corners_that_are_shut_in_get_less_light():
    crowding = [(0, 1, 2, 3)]
    rgb, _, _ = painted(quads([level(-0.15, -0.15, 0.2)], (1, 1, 1), crowding), lamp())
    for (s, t), share in zip([(0.05, 0.05), (0.95, 0.05), (0.95, 0.95), (0.05, 0.95)],
                             CROWDED, strict=True):  # fmt: skip
        light = rgb[pixel((-0.15 + 0.3 * s, -0.15 + 0.3 * t, 0.2))][0]
        assert abs(light - (0.4 * share + 0.6 * (0.5 + 0.5 * share))) < 0.05


def test_either_sign_of_a_normal_gives_the_same_picture():
    squares = quads([level(-0.15, -0.15, 0.2)], (0.8, 0.8, 0.8))
    mood = MOOD._replace(smooth=0.7)
    squares.normal[:] = (0.5, 0.1, 0.86)
    one = painted(squares, lamp(), mood=mood)[0]
    squares.normal[:] *= -1
    np.testing.assert_array_equal(one, painted(squares, lamp(), mood=mood)[0])
