"""The cameras' pictures, kept until the clouds of their instants are fused."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.camera import ColorImage
from schemas.cloud import Cloud, DepthCloud
from services.mapper.errors import BadColor
from services.runtime.errors import MissingExtra

_KEPT = 4
"""Pictures of one camera: a cloud may wait for other cameras while newer pictures come."""
_START, _END_OF_HEADER = b"\xff\xd8", 0xDA
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of the segments that tell an image's size (ITU-T T.81, table B.1)."""


class Album(Protocol):
    """Where pictures wait."""

    num_missing: int
    """Depth clouds that were fused without a picture."""

    def keep(self, image: ColorImage) -> None:
        """Keep a picture."""

    def of(self, cloud: Cloud) -> NDArray[np.uint8] | None:
        """Return the (H, W, 3) red, green, blue of a cloud's pixels; None if there is none."""


class NoPictures:
    """Nobody asked for colors."""

    num_missing = 0

    def keep(self, image: ColorImage) -> None:
        """Let it go."""

    def of(self, cloud: Cloud) -> NDArray[np.uint8] | None:  # noqa: ARG002
        """There is none, and none is missed."""
        return None


class Pictures:
    """The newest JPEG pictures of every camera; unpacked when their cloud is fused.

    Raises:
        MissingExtra: If OpenCV is not installed.
    """

    def __init__(self) -> None:
        self._cv2 = _opencv()
        self._newest: dict[int, dict[int, ColorImage]] = {}
        self.num_missing = 0

    def keep(self, image: ColorImage) -> None:
        """Keep a picture in place of the camera's oldest."""
        kept = self._newest.setdefault(image.camera, {})
        kept.pop(image.tick, None)
        kept[image.tick] = image
        while len(kept) > _KEPT:
            del kept[next(iter(kept))]

    def of(self, cloud: Cloud) -> NDArray[np.uint8] | None:
        """Return the (H, W, 3) red, green, blue of a cloud's pixels; None if there is none.

        Raises:
            BadColor: If the picture cannot be unpacked or is not of the depth image's size.
        """
        if not isinstance(cloud, DepthCloud):
            return None
        image = self._newest.get(cloud.camera, {}).pop(cloud.tick, None)
        if image is None:
            self.num_missing += 1
            return None
        try:
            return self._unpacked(image.array, cloud.shape)
        except BadColor:
            self.num_missing += 1
            raise

    def _unpacked(self, jpeg: NDArray[np.uint8], wanted: tuple[int, ...]) -> NDArray[np.uint8]:
        size = jpeg_size(jpeg.tobytes())
        if size != wanted:  # Before it is unpacked: its header may ask for gigabytes.
            raise BadColor(f"picture is {size}; its depth image is {wanted} (height, width)")
        bgr = self._cv2.imdecode(jpeg, self._cv2.IMREAD_COLOR | self._cv2.IMREAD_IGNORE_ORIENTATION)
        if bgr is None or bgr.shape != (*wanted, 3):
            raise BadColor(f"picture of {len(jpeg)} bytes cannot be unpacked")
        return np.ascontiguousarray(bgr[..., ::-1])


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Return height and width of a JPEG, from its header.

    Raises:
        BadColor: If it is none.
    """
    at = 2
    while data.startswith(_START) and at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in _FRAMES:
            height, width = data[at + 5 : at + 7], data[at + 7 : at + 9]
            return int.from_bytes(height, "big"), int.from_bytes(width, "big")
        if marker == _END_OF_HEADER or length < 2:
            break
        at += 2 + length
    raise BadColor(f"picture of {len(data)} bytes is no JPEG")


def _opencv() -> Any:
    try:
        import cv2
    except ImportError as error:
        raise MissingExtra(
            f"colors need OpenCV ({error}): pip install 'encircle[color]'"
        ) from error
    return cv2
