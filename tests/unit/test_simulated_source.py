"""The simulated camera as a whole: state in, image out."""

import sys

import numpy as np
import pytest

from schemas.camera import Intrinsics
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody, DeformationSpec, SceneSpec, SimState
from services.camera.sources.depth_sensor import DepthSettings
from services.camera.sources.open import open_source
from services.camera.sources.simulated import SimulatedSettings, body_of
from services.kernels.rigid import look_at, planar
from services.runtime.errors import MissingExtra
from services.world.scene import Scene
from tests.raycast_reference import RayCaster

pytestmark = pytest.mark.unit

OPTICS = Intrinsics.from_vertical_fov(160, 120, np.radians(45))
K = (OPTICS.fx, OPTICS.fy, OPTICS.cx, OPTICS.cy)
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
T_WORLD_TARGET = planar(0.7, -0.4, 1.0)


def scene(object="bunny", deformations=()):
    return SceneSpec(object=object, height_m=0.4, subdivide=2, deformations=deformations, seed=5)


def state(tick=3, spec=None, eyes=((1.7, -0.3, 0.5), (0.2, 0.9, 0.7)), target=T_WORLD_TARGET):
    poses = [look_at(eye, target[:3, 3] + [0, 0, 0.2]) for eye in eyes]
    return SimState(
        t_ns=tick * 66_666_667,
        tick=tick,
        frame_id="world",
        dt_ns=66_666_667,
        mode="lockstep",
        target=Pose.from_matrix(target),
        twist=STILL,
        scene=spec or scene(),
        cameras=[
            CameraBody(camera=i, pose=Pose.from_matrix(T), twist=STILL) for i, T in enumerate(poses)
        ],
    )


def source(camera=0, noise="ideal", color=False, **depth):
    settings = SimulatedSettings(
        camera=camera, seed=9, intrinsics=OPTICS, color=color, noise=noise, **depth
    )
    return open_source(settings)


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("tick", [0, 7])
def test_an_ideal_image_is_the_deformed_moved_body_on_the_ground(camera, tick):
    spec = scene(deformations=[DeformationSpec(kind="bend", amplitude=0.4, hz=0.7)])
    now = state(tick, spec)
    raw = source(camera).capture(now, color=False).depth
    truth = Scene.from_spec(spec)
    vertices = truth.vertices_world(now.t_ns * 1e-9, T_WORLD_TARGET)
    floor = np.array([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], np.float32)
    faces = np.concatenate([truth.faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(vertices)])
    T = now.cameras[camera].pose.matrix()
    depth = RayCaster(np.concatenate([vertices, floor]), faces).depth_m(T, K, 160, 120)
    returned = depth <= 5.0
    differs = returned != (raw != 65535)
    assert differs.sum() <= 5
    both = returned & ~differs
    assert 0.3 < both.mean() < 1.0
    np.testing.assert_allclose(raw[both] * 0.001, depth[both], atol=0.0006)


@pytest.mark.parametrize("noise", ["nguyen", "d4xx"])
def test_a_noisy_image_is_the_ideal_one_within_its_noise_but_for_edges_and_dropout(noise):
    ideal = source().capture(state(), color=False).depth.astype(int)
    noisy = source(noise=noise).capture(state(), color=False).depth.astype(int)
    assert 0.003 < (noisy == 0).mean() < 0.1
    known = (noisy != 0) & (ideal != 65535) & (ideal < 2000)
    error_m = np.abs(noisy - ideal)[known] * 0.001
    assert 0.0005 < np.median(error_m) < 0.02
    assert (error_m > 0.1).mean() < 0.05


@pytest.mark.parametrize("noise", ["ideal", "nguyen", "d4xx"])
def test_the_same_instant_gives_the_same_image_whatever_was_seen_before(noise):
    fresh, used = source(noise=noise), source(noise=noise)
    used.capture(state(1, scene("sphere")), color=False)
    used.capture(state(2), color=False)
    one, other = (each.capture(state(), color=False).depth for each in (fresh, used))
    np.testing.assert_array_equal(one, other)
    assert not np.shares_memory(one, used.capture(state(), color=False).depth)


def test_noise_changes_with_the_tick_and_the_camera():
    static = state(1), state(2)
    one, two = (source(noise="nguyen").capture(each, color=False).depth for each in static)
    assert (one != two).mean() > 0.3
    twins = state(eyes=[(1.7, -0.3, 0.5)] * 2)
    one, two = (source(i, "nguyen").capture(twins, color=False).depth for i in (0, 1))
    assert (one != two).mean() > 0.3


def test_a_surface_nearer_than_the_minimum_range_is_invalid_and_hides_what_is_behind():
    now = state(eyes=[(0.7, -0.4, 0.45)])  # 5 cm above the head, looking down.
    raw = source(min_range_m=0.3).capture(now, color=False).depth
    closest = source(min_range_m=0.01).capture(now, color=False).depth
    np.testing.assert_array_equal(raw == 0, closest < 300)
    assert (raw == 0).any()


def test_a_camera_without_a_body_is_told_apart():
    assert body_of(state(), 1).camera == 1
    assert body_of(state(), 2) is None


def test_a_picture_is_made_only_when_asked_for():
    camera = source(color=True)
    assert camera.capture(state(), color=False).jpeg is None
    jpeg = camera.capture(state(), color=True).jpeg
    assert jpeg[:2].tobytes() == b"\xff\xd8"
    import cv2

    assert cv2.imdecode(jpeg, cv2.IMREAD_COLOR).shape == (120, 160, 3)


def test_colour_without_opencv_names_the_extra_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    source(color=False)
    with pytest.raises(MissingExtra, match=r"pip install 'encircle\[color\]'"):
        source(color=True)


def test_ranges_that_cannot_be_are_refused_by_name():
    with pytest.raises(ValueError, match=r"min_range_m 2 must be below max_range_m 1"):
        DepthSettings(min_range_m=2, max_range_m=1)
    with pytest.raises(ValueError, match=r"max_range_m 70 .*depth_scale_m"):
        DepthSettings(max_range_m=70)
