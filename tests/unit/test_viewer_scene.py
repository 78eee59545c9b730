"""Messages become primitives: cameras, sectors, polygon, path, clouds."""

import math

import numpy as np
import pytest

from schemas.camera import CameraInfo, CameraPose, Intrinsics
from schemas.cloud import INVALID, NO_RETURN, DepthCloud
from schemas.formation import Formation
from schemas.geometry import Pose, Twist
from schemas.map import OCCUPIED, MapChanges
from schemas.target import TargetPose
from services.kernels.rigid import apply, look_at, planar
from services.viewer.colours import PLASMA, VIRIDIS, camera_colour, shades
from services.viewer.frusta import depth_image, field_of_view
from services.viewer.newest import Newest
from services.viewer.options import Options
from services.viewer.pictures import MAX_WIDTH_PX, pictures
from services.viewer.scene import frame, merged_cloud
from services.viewer.trail import Trail
from services.viewer.voxels import Voxels
from services.viewer.wedges import rims, sectors, wedges

pytestmark = pytest.mark.unit


@pytest.fixture
def rng():
    return np.random.default_rng(20)


STAMP = {"t_ns": 0, "tick": 0, "frame_id": "world"}
STILL = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
OPTICS = Intrinsics.from_vertical_fov(64, 48, math.radians(45))


def camera_pose(camera, num=3):
    angle = math.tau * camera / num
    eye = (1.2 * math.cos(angle), 1.2 * math.sin(angle), 0.6)
    return Pose.from_matrix(look_at(eye, (0, 0, 0.2)))


def info(camera, optics=OPTICS):
    return CameraInfo(
        **STAMP, camera=camera, intrinsics=optics, depth_scale_m=0.001, min_range_m=0.1,
        max_range_m=5.0, noise="ideal",
    )  # fmt: skip


def cloud(camera, depth, optics=OPTICS):
    return DepthCloud.of(
        depth, **STAMP, camera=camera, pose=camera_pose(camera), max_range_m=5.0, t_capture_ns=0,
        intrinsics=optics, depth_scale_m=0.001,
    )  # fmt: skip


def newest(cameras=3):
    made = Newest()
    for camera in range(cameras):
        made.infos[camera] = info(camera)
        made.poses[camera] = CameraPose(
            **STAMP, camera=camera, pose=camera_pose(camera), twist=STILL
        )
    corners = tuple(camera_pose(camera).position for camera in range(cameras))
    made.formation = Formation(
        **STAMP, strategy="circle", centre=(0, 0, 0.2), radius_m=1.2, references=(),
        polygon=corners,
    )  # fmt: skip
    made.target = TargetPose(**STAMP, pose=Pose.from_matrix(planar(0.3, 0.1, 1.0)), twist=STILL)
    return made


def map_changes(voxels, size_m):
    rows = np.column_stack([voxels, np.full(len(voxels), OCCUPIED)]).astype(np.int16)
    return MapChanges.of(
        rows, **STAMP, rev=1, base_rev=0, resolution_m=size_m, origin=(0.0, 0.0, 0.0),
        shape_voxels=(80, 80, 80), pose=Pose.from_matrix(np.eye(4)),
    )  # fmt: skip


def in_world(lines):
    """(N, 2, 3)."""
    return apply(lines.T_world_lines, lines.segments_m.reshape(-1, 3)).reshape(-1, 2, 3)


def drawn(made, **options):
    return frame(made, Voxels(), Trail(), Options(**options))


def test_every_camera_that_is_known_has_its_pyramid():
    made = newest()
    del made.infos[1]  # Its optics have not come yet.
    frusta = drawn(made).frusta
    assert [frustum.camera for frustum in frusta] == [0, 2]
    for frustum in frusta:
        np.testing.assert_allclose(
            frustum.T_world_camera, camera_pose(frustum.camera).matrix(), atol=1e-12
        )
        assert frustum.vfov_rad == pytest.approx(math.radians(45))
        assert frustum.aspect == pytest.approx(64 / 48)


def test_a_camera_that_has_gone_is_not_drawn():
    made = newest()
    made.clouds[1] = cloud(1, np.full((48, 64), 900, np.uint16))
    made.forget_camera(1)
    assert [frustum.camera for frustum in drawn(made).frusta] == [0, 2]
    assert pictures(made) == {}


def test_the_polygon_is_closed_and_goes_through_the_cameras():
    lines = drawn(newest(5)).formation
    segments = in_world(lines)
    assert len(segments) == 5
    np.testing.assert_allclose(segments[:, 1], np.roll(segments[:, 0], -1, axis=0))
    np.testing.assert_allclose(segments[2, 0], camera_pose(2, 3).position, atol=1e-3)


def test_what_goes_with_the_target_keeps_its_shape_while_the_target_drives():
    """A browser that is behind would draw an old shape at a new place."""
    shapes = []
    for step in range(3):
        T_world_target = planar(0.4 * step, -0.2 * step, 0.5 * step)
        made = newest()
        for camera, told in made.poses.items():
            pose = Pose.from_matrix(T_world_target @ camera_pose(camera).matrix())
            made.poses[camera] = told.model_copy(update={"pose": pose})
        corners = tuple(told.pose.position for told in made.poses.values())
        centre = tuple(T_world_target[:3, 3])
        made.formation = made.formation.model_copy(update={"polygon": corners, "centre": centre})
        made.target = made.target.model_copy(update={"pose": Pose.from_matrix(T_world_target)})
        shapes.append(drawn(made))
        np.testing.assert_allclose(in_world(shapes[-1].formation)[:, 0], corners, atol=2e-3)
    for now in shapes[1:]:
        np.testing.assert_array_equal(now.formation.segments_m, shapes[0].formation.segments_m)
        np.testing.assert_array_equal(now.wedges.vertices_m, shapes[0].wedges.vertices_m)
        np.testing.assert_array_equal(now.rims.segments_m, shapes[0].rims.segments_m)


def test_a_sector_lies_on_the_ground_and_spans_the_field_of_view():
    hfov = field_of_view(OPTICS.width, OPTICS.fx)
    T = camera_pose(0).matrix()
    T_world_sectors = planar(0.4, -0.3, 0.7)
    views = {0: (T, hfov), 4: (camera_pose(1).matrix(), hfov)}
    found = sectors(views, 2.0, 0.01, T_world_sectors)
    surface = wedges(found, T_world_sectors)
    vertices = apply(surface.T_world_surface, surface.vertices_m)
    np.testing.assert_allclose(vertices[:, 2], 0.01)
    apex, first, last = vertices[surface.faces[0][0]], *vertices[[1, 13]]
    np.testing.assert_allclose(apex[:2], T[:2, 3], atol=1e-3)
    one, other = (first - apex)[:2], (last - apex)[:2]
    assert np.linalg.norm(one) == pytest.approx(2.0, abs=2e-3)
    cosine = one @ other / (np.linalg.norm(one) * np.linalg.norm(other))
    assert math.acos(cosine) == pytest.approx(hfov, abs=2e-3)
    middle = (one + other) / np.linalg.norm(one + other)
    np.testing.assert_allclose(middle, T[:2, 2] / np.linalg.norm(T[:2, 2]), atol=2e-3)
    lines = rims(found, T_world_sectors)
    assert {tuple(corner) for corner in lines.segments_m.reshape(-1, 3)} == {
        tuple(corner) for corner in surface.vertices_m
    }
    assert tuple(lines.colours[0, 0]) == camera_colour(0)
    assert tuple(lines.colours[-1, 0]) == camera_colour(4)


def test_what_lies_on_the_ground_lies_above_the_mapped_ground():
    made, trail, voxels = newest(), Trail(), Voxels()
    for step in range(5):
        trail.add(float(step), np.array([0.1 * step, 0.0, 0.0]))
    ground = np.argwhere(np.ones((8, 8, 1), bool)).astype(np.int64)
    voxels.update(map_changes(ground, 0.05), ground)
    top_m = voxels.centres_m[:, 2].max() + 0.5 * 0.05
    shown = frame(made, voxels, trail, Options())
    for lines in (shown.path, shown.trail, shown.rims):
        assert in_world(lines)[..., 2].min() > top_m
    alone = frame(made, voxels, trail, Options(voxels=False))
    assert in_world(alone.path)[..., 2].max() < 0.01


def test_a_camera_that_looks_straight_down_has_no_sector():
    assert sectors({0: (look_at((0, 0, 2), (0, 0, 0)), 1.0)}, 1.0, 0.0, np.eye(4)) == {}
    assert wedges({}, np.eye(4)) is None
    assert rims({}, np.eye(4)) is None


def test_switched_off_is_not_drawn():
    everything = drawn(newest(), cloud=True)
    assert everything.frusta
    assert everything.wedges is not None
    nothing = drawn(
        newest(), cameras=False, wedges=False, formation=False, trail=False, voxels=False
    )
    assert nothing.frusta == ()
    assert (nothing.wedges, nothing.rims, nothing.formation) == (None,) * 3
    assert (nothing.path, nothing.trail, nothing.voxels) == (None,) * 3


def test_the_target_is_in_the_middle_if_it_is_followed():
    assert drawn(newest(), follow=True).middle_m == pytest.approx((0.3, 0.1))
    assert drawn(newest(), follow=False).middle_m == (0.0, 0.0)


def test_the_trail_is_of_the_last_seconds_and_the_path_of_all():
    trail = Trail(span_s=2.0)
    T_world_target = planar(5.0, 0.0, 0.3)
    assert trail.path(0.0) is None
    assert trail.recent(0.0, T_world_target) is None
    for step in range(101):
        trail.add(0.1 * step, np.array([0.05 * step, 0.0, 0.0]))
    path = in_world(trail.path(0.1))
    assert path[:, :, 0].min() == pytest.approx(0.0)
    np.testing.assert_allclose(path[:, :, 2], 0.1, atol=1e-6)
    recent = in_world(trail.recent(0.1, T_world_target))
    assert recent[0, 0, 0] == pytest.approx(0.05 * 80, abs=0.051)
    assert recent[-1, 1, 0] == pytest.approx(5.0)
    assert recent[:, :, 2].min() > 0.1
    colours = trail.recent(0.1, T_world_target).colours.astype(int)
    assert (np.ptp(colours, axis=2)[1:, 0] >= np.ptp(colours, axis=2)[:-1, 0]).all()


def test_memory_of_the_path_is_bounded_however_long_it_is():
    trail = Trail()
    for step in range(40_000):
        trail.add(0.01 * step, np.array([0.05 * step, 0.0, 0.0]))
    segments = trail.path(0.0).segments_m
    assert len(segments) <= 1024
    assert len(trail.recent(0.0, np.eye(4)).segments_m) <= 1024
    assert segments[:, :, 0].min() == 0.0
    assert segments[:, :, 0].max() == pytest.approx(2000.0, rel=1e-3)


def test_a_new_run_begins_a_new_path():
    trail = Trail()
    for step in range(50):
        trail.add(10.0 + step, np.array([step, 0.0, 0.0]))
    trail.add(0.0, np.zeros(3))
    assert trail.path(0.0) is None
    assert trail.recent(0.0, np.eye(4)) is None


def test_near_is_bright_and_nothing_is_dark(rng):
    depth = rng.integers(500, 2000, (48, 64)).astype(np.uint16)
    depth[0, 0], depth[0, 1] = INVALID, NO_RETURN
    depth[10, 10], depth[20, 20] = 400, 2500
    image = depth_image(cloud(0, depth), 64)
    assert image.shape == (48, 64, 3)
    assert tuple(image[0, 0]) == tuple(image[0, 1])
    assert tuple(image[10, 10]) == tuple(PLASMA[255])
    assert tuple(image[20, 20]) == tuple(PLASMA[0])


@pytest.mark.parametrize("width", [320, 640, 1280, 333])
def test_pictures_are_no_wider_than_they_may_be(width):
    optics = Intrinsics.from_vertical_fov(width, 48, 0.8)
    made = Newest()
    made.clouds[0] = cloud(0, np.full((48, width), 900, np.uint16), optics)
    assert pictures(made)[0].shape[1] <= MAX_WIDTH_PX


def test_an_image_that_saw_nothing_has_no_brightest_pixel():
    image = depth_image(cloud(0, np.zeros((48, 64), np.uint16)), 64)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) == 1


def test_the_merged_cloud_holds_all_returns_in_their_places():
    clouds = {camera: cloud(camera, np.full((48, 64), 900, np.uint16)) for camera in range(3)}
    points = merged_cloud(clouds, 100_000)
    expected = np.concatenate([each.points_world() for each in clouds.values()])
    np.testing.assert_allclose(points.positions_m, expected, atol=1e-5)
    assert points.num_true == 3 * 48 * 64
    assert len(np.unique(points.colours, axis=0)) == 3
    thinned = merged_cloud(clouds, 600)
    assert len(thinned.positions_m) <= 600
    assert thinned.num_true == 3 * 48 * 64


def test_shades_go_from_the_tables_first_to_its_last(rng):
    values = np.sort(rng.uniform(-1, 2, 100))
    colours = shades(values, 0.0, 1.0, VIRIDIS)
    assert (colours[values <= 0] == VIRIDIS[0]).all()
    assert (colours[values >= 1] == VIRIDIS[-1]).all()
    assert (np.diff(colours[:, 1].astype(int)) >= 0).all()  # Viridis grows greener throughout.
    assert tuple(shades([math.nan], 0.0, 1.0, VIRIDIS)[0]) == tuple(VIRIDIS[0])
    assert tuple(shades([5.0], 1.0, 1.0, VIRIDIS)[0]) == tuple(VIRIDIS[0])
