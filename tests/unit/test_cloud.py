"""Both kinds of cloud give the same points."""

import numpy as np
import pytest

from schemas.camera import Intrinsics
from schemas.cloud import INVALID, NO_RETURN, DepthCloud, XyzCloud
from schemas.geometry import Pose

pytestmark = pytest.mark.unit

OPTICS = Intrinsics.from_vertical_fov(32, 24, np.radians(45))
SHOT = {
    "t_ns": 0,
    "tick": 0,
    "frame_id": "world",
    "camera": 0,
    "max_range_m": 5.0,
    "t_capture_ns": 0,
    "pose": Pose(position=(1, 2, 3), orientation=(0.5, -0.5, 0.5, 0.5)),
}


def depth_cloud(depth: np.ndarray) -> DepthCloud:
    return DepthCloud.of(depth.astype("<u2"), **SHOT, intrinsics=OPTICS, depth_scale_m=0.001)


def test_projecting_an_unprojected_pixel_returns_the_pixel() -> None:
    depth = np.random.default_rng(1).integers(500, 4000, (24, 32))
    points = depth_cloud(depth).points_world()
    T = np.linalg.inv(SHOT["pose"].matrix())
    x, y, z = (points @ T[:3, :3].T + T[:3, 3]).T
    v, u = np.indices((24, 32)).reshape(2, -1)
    np.testing.assert_allclose(OPTICS.fx * x / z + OPTICS.cx, u, atol=1e-9)
    np.testing.assert_allclose(OPTICS.fy * y / z + OPTICS.cy, v, atol=1e-9)


def test_pixels_without_a_return_give_no_point() -> None:
    depth = np.full((24, 32), 1000)
    depth[0, :5], depth[1, :7] = INVALID, NO_RETURN
    assert len(depth_cloud(depth).points_world()) == 24 * 32 - 12


def test_an_xyz_cloud_of_the_same_points_is_the_same_in_the_world() -> None:
    depth = np.random.default_rng(2).integers(500, 4000, (24, 32))
    v, u = np.indices(depth.shape).reshape(2, -1)
    z = depth.reshape(-1) * 0.001
    points = np.stack([(u - OPTICS.cx) / OPTICS.fx * z, (v - OPTICS.cy) / OPTICS.fy * z, z], 1)
    points = np.vstack([points, [np.nan, 0, 1]]).astype("<f4")
    cloud = XyzCloud.of(points, **SHOT)
    np.testing.assert_allclose(cloud.points_world(), depth_cloud(depth).points_world(), atol=1e-6)


def test_an_image_of_another_size_than_its_intrinsics_is_refused() -> None:
    with pytest.raises(ValueError, match="height, width"):
        depth_cloud(np.zeros((32, 24)))
