"""Pictures find their cloud, or are missed and counted."""

import cv2
import numpy as np
import pytest

from schemas.camera import ColorImage, Intrinsics
from schemas.cloud import DepthCloud, XyzCloud
from schemas.geometry import Pose
from services.mapper.errors import BadColor
from services.mapper.pictures import NoPictures, Pictures, jpeg_size

pytestmark = pytest.mark.unit

HEIGHT, WIDTH = 24, 32


def jpeg_of(bgr: tuple[int, int, int], height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    picture = np.full((height, width, 3), bgr, np.uint8)
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].reshape(-1)


def image(tick: int, camera: int = 0, data: np.ndarray | None = None) -> ColorImage:
    data = jpeg_of((tick, 0, 200)) if data is None else data
    stamp = {"t_ns": 0, "tick": tick, "frame_id": "cam", "camera": camera}
    return ColorImage.of(data, **stamp, width=WIDTH, height=HEIGHT)


def cloud(tick: int, camera: int = 0) -> DepthCloud:
    return DepthCloud.of(
        np.zeros((HEIGHT, WIDTH), np.uint16),
        t_ns=0,
        tick=tick,
        frame_id="world",
        camera=camera,
        pose=Pose.from_matrix(np.eye(4)),
        max_range_m=5.0,
        t_capture_ns=0,
        intrinsics=Intrinsics.from_vertical_fov(WIDTH, HEIGHT, 0.8),
        depth_scale_m=0.001,
    )


def test_a_cloud_gets_the_picture_of_its_camera_and_instant_as_red_green_blue() -> None:
    pictures = Pictures()
    for tick in (10, 60):
        pictures.keep(image(tick))
    pictures.keep(image(200, camera=1))
    for tick, camera in ((60, 0), (10, 0), (200, 1)):
        picture = pictures.of(cloud(tick, camera))
        assert picture.shape == (HEIGHT, WIDTH, 3)
        assert np.abs(picture.astype(int) - (200, 0, tick)).max() < 8
    assert pictures.num_missing == 0


def test_what_has_no_picture_is_counted_and_points_need_none() -> None:
    pictures = Pictures()
    pictures.keep(image(1))
    points = np.zeros((1, 3), np.float32)
    shot = {"pose": Pose.from_matrix(np.eye(4)), "max_range_m": 5.0, "t_capture_ns": 0}
    xyz = XyzCloud.of(points, t_ns=0, tick=1, frame_id="world", camera=0, **shot)
    assert pictures.of(xyz) is None
    assert pictures.num_missing == 0
    assert pictures.of(cloud(2)) is None
    assert pictures.of(cloud(1, camera=1)) is None
    assert pictures.num_missing == 2
    assert NoPictures().of(cloud(1)) is None


def test_only_the_newest_pictures_of_a_camera_wait() -> None:
    pictures = Pictures()
    for tick in range(1, 100):
        pictures.keep(image(tick))
    assert pictures.of(cloud(1)) is None
    assert pictures.of(cloud(99)) is not None


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (np.zeros(0, np.uint8), "no JPEG"),
        (np.zeros(100, np.uint8), "no JPEG"),
        (jpeg_of((0, 0, 0))[:12], "no JPEG"),
        (jpeg_of((0, 0, 0), HEIGHT * 2), r"\(48, 32\); its depth image is \(24, 32\)"),
    ],
)
def test_a_picture_that_is_none_is_refused_and_counted(data: np.ndarray, says: str) -> None:
    pictures = Pictures()
    pictures.keep(image(1, data=data))
    with pytest.raises(BadColor, match=says):
        pictures.of(cloud(1))
    assert pictures.num_missing == 1


def test_a_header_that_asks_for_gigabytes_is_refused_before_it_is_unpacked() -> None:
    data = jpeg_of((0, 0, 0)).copy()
    at = int(np.flatnonzero((data[:-1] == 0xFF) & (data[1:] == 0xC0))[0])
    data[at + 5 : at + 9] = 0xFF
    assert jpeg_size(data.tobytes()) == (65535, 65535)
    pictures = Pictures()
    pictures.keep(image(1, data=data))
    with pytest.raises(BadColor, match="65535"):
        pictures.of(cloud(1))


def test_the_size_of_any_cut_of_a_jpeg_is_told_or_refused() -> None:
    data = jpeg_of((1, 2, 3)).tobytes()
    assert jpeg_size(data) == (HEIGHT, WIDTH)
    for end in range(0, len(data), 7):
        try:
            assert jpeg_size(data[:end]) == (HEIGHT, WIDTH)
        except BadColor:
            continue
