"""Every value of ours is found again in Foxglove's words."""

import numpy as np
import pytest

pytest.importorskip("foxglove_schemas_protobuf")

from schemas.camera import CameraGoal, CameraInfo, CameraPose, ColorImage, Intrinsics
from schemas.cloud import DepthCloud, XyzCloud
from schemas.formation import Formation
from schemas.geometry import WORLD, Pose, Twist
from schemas.target import TargetPose
from services.kernels.rigid import look_at
from services.recorder.export.foxglove import converted

pytestmark = pytest.mark.unit

T_NS = 3_000_000_250
STAMP = {"t_ns": T_NS, "tick": 7, "frame_id": WORLD}
POSE = Pose.from_matrix(look_at((1.0, -2.0, 0.7), (0.1, 0, 0.2)))
TWIST = Twist(linear=(1, 0, 0), angular=(0, 0, 1))
OPTICS = Intrinsics(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.5)


def said(message, pixel_step=1):
    return {each.topic: each.message for each in converted(message, T_NS, pixel_step)}


def depth_cloud(scale_m=0.001):
    depth = np.random.default_rng(0).integers(500, 4000, (6, 8)).astype(np.uint16)
    depth[0, 0], depth[5, 7] = 0, 65535
    return DepthCloud.of(
        depth, **STAMP, camera=3, pose=POSE, max_range_m=5.0, t_capture_ns=1, intrinsics=OPTICS,
        depth_scale_m=scale_m,
    )  # fmt: skip


def pose_of(message):
    p, q = message.position, message.orientation
    return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def points_of(cloud):
    assert [(f.name, f.offset, f.type) for f in cloud.fields] == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7)
    ]  # fmt: skip  # 7 is FLOAT32.
    assert cloud.point_stride == 12
    return np.frombuffer(cloud.data, "<f4").reshape(-1, 3)


def stamp_of(message):
    return message.timestamp.seconds * 1_000_000_000 + message.timestamp.nanos


def test_poses_go_over_unchanged():
    target = said(TargetPose(**STAMP, pose=POSE, twist=TWIST))
    camera = said(CameraPose(**STAMP, camera=3, pose=POSE, twist=TWIST))
    goal = said(CameraGoal(**STAMP, camera=3, pose=POSE, twist=TWIST))
    poses = (target["/target/pose"], camera["/cams/3/pose"], goal["/cams/3/goal"])
    for message in poses:
        assert message.frame_id == WORLD
        assert stamp_of(message) == T_NS
        assert pose_of(message.pose) == (POSE.position, POSE.orientation)
    for message, child in ((target["/tf"], "target"), (camera["/tf"], "cam_3_optical")):
        assert (message.parent_frame_id, message.child_frame_id) == (WORLD, child)
        t, r = message.translation, message.rotation
        assert (t.x, t.y, t.z) == POSE.position
        assert (r.x, r.y, r.z, r.w) == POSE.orientation


def test_a_depth_image_is_the_same_pixels_and_what_did_not_return_is_zero():
    cloud = depth_cloud()
    image = said(cloud)["/cams/3/depth"]
    assert (image.encoding, image.width, image.height, image.step) == ("16UC1", 8, 6, 16)
    assert image.frame_id == "cam_3_optical"
    pixels = np.frombuffer(image.data, "<u2").reshape(6, 8)
    np.testing.assert_array_equal(pixels, np.where(cloud.array == 65535, 0, cloud.array))


def test_depth_is_in_millimetres_whatever_the_sensors_unit():
    cloud = depth_cloud(scale_m=0.0025)
    pixels = np.frombuffer(said(cloud)["/cams/3/depth"].data, "<u2").reshape(6, 8)
    known = (cloud.array > 0) & (cloud.array < 65535)
    np.testing.assert_allclose(pixels[known], cloud.array[known] * 2.5, atol=0.5)
    far = said(depth_cloud(scale_m=0.1))["/cams/3/depth"]  # Up to 400 m: beyond 16 bits of mm.
    far_pixels = np.frombuffer(far.data, "<u2").reshape(6, 8)
    beyond = depth_cloud().array * 100.0 >= 65535
    assert not far_pixels[beyond].any()


def test_the_calibration_is_k_with_the_same_centre_in_p():
    for message in (depth_cloud(), CameraInfo(
        **STAMP, camera=3, intrinsics=OPTICS, depth_scale_m=0.001, min_range_m=0.1,
        max_range_m=5.0, noise="unknown",
    )):  # fmt: skip
        calibration = said(message)["/cams/3/calibration"]
        assert (calibration.width, calibration.height) == (8, 6)
        assert list(calibration.K) == [7.0, 0, 3.25, 0, 7.5, 2.5, 0, 0, 1]
        K = np.array(calibration.K).reshape(3, 3)
        np.testing.assert_array_equal(np.array(calibration.P).reshape(3, 4)[:, :3], K)
        assert list(calibration.R) == [1, 0, 0, 0, 1, 0, 0, 0, 1]


def test_points_in_their_frame_are_the_clouds_points_in_the_world():
    cloud = depth_cloud()
    messages = said(cloud)
    tf, points = messages["/tf"], points_of(messages["/cams/3/points"])
    assert messages["/cams/3/points"].frame_id == tf.child_frame_id == "cam_3_optical"
    T = POSE.matrix()
    np.testing.assert_allclose(points @ T[:3, :3].T + T[:3, 3], cloud.points_world(), atol=1e-6)


def test_a_projected_point_lies_where_k_says():
    messages = said(depth_cloud())
    K = np.array(messages["/cams/3/calibration"].K).reshape(3, 3)
    depth = np.frombuffer(messages["/cams/3/depth"].data, "<u2").reshape(6, 8)
    for point in points_of(messages["/cams/3/points"]):
        u, v, w = K @ point
        np.testing.assert_allclose([u / w, v / w], np.rint([u / w, v / w]), atol=1e-4)
        assert depth[round(v / w), round(u / w)] == round(1000 * w)


def test_fewer_points_are_those_of_every_nth_pixel():
    every = points_of(said(depth_cloud(), pixel_step=1)["/cams/3/points"])
    some = points_of(said(depth_cloud(), pixel_step=3)["/cams/3/points"])
    assert len(some) == 5  # 2 rows of 3 pixels, without the corner that knows nothing.
    assert {tuple(p) for p in some.tolist()} <= {tuple(p) for p in every.tolist()}
    assert "/cams/3/points" not in said(depth_cloud(), pixel_step=0)


def test_unorganised_points_go_over_without_what_is_not_finite():
    points = np.array([[1, 2, 3], [np.nan, 0, 0], [4, 5, 6]], np.float32)
    cloud = XyzCloud.of(points, **STAMP, camera=1, pose=POSE, max_range_m=9.0, t_capture_ns=1)
    messages = said(cloud)
    np.testing.assert_array_equal(points_of(messages["/cams/1/points"]), points[[0, 2]])
    assert messages["/tf"].child_frame_id == "cam_1_optical"


def test_a_jpeg_is_the_same_bytes():
    data = np.arange(200, dtype=np.uint8)
    image = ColorImage.of(data, **STAMP, camera=2, width=4, height=3)
    compressed = said(image)["/cams/2/color"]
    assert (compressed.format, compressed.frame_id) == ("jpeg", "cam_2_optical")
    assert compressed.data == data.tobytes()


def test_a_formation_is_a_closed_line_and_one_without_a_polygon_clears_it():
    corners = ((0, 0, 1), (1, 0, 1), (0, 1, 1))
    fields = {"strategy": "circle", "centre": (0, 0, 0.2), "radius_m": 1.0, "references": ()}
    (entity,) = said(Formation(**STAMP, **fields, polygon=corners))["/formation"].entities
    (line,) = entity.lines
    assert tuple((p.x, p.y, p.z) for p in line.points) == corners
    assert line.type == line.LINE_LOOP
    (cleared,) = said(Formation(**STAMP, **fields, polygon=()))["/formation"].entities
    assert cleared.id == entity.id
    assert not cleared.lines
